"""The one element every drawing is in."""

from html import escape

from markupsafe import Markup


def svg(title: str, width: float, height: float, body: str, style: str) -> Markup:
    """An inline SVG with an accessible title, as wide as the page lets it; `body` is markup, `title` is text."""
    name = escape(title)
    return Markup(
        f'<svg class="{style}" role="img" aria-label="{name}" viewBox="0 0 {width:.6g} {height:.6g}">'
        f"<title>{name}</title>{body}</svg>"
    )
