//! The shape of a board that is not quite flat: bent along each side like a parabola, as boards of paper and plastic are.

use nalgebra::{Vector2, Vector3};

/// The rectangle of a board's corners, for the bend of a board that is not quite flat.
///
/// With x and y from -1 to 1 over the corners, `z = w_x (1 - x²) + w_y (1 - y²)`: two parabolas, as in mrcal's
/// `calobject_warp`.
#[derive(Debug, Clone, Copy)]
pub(super) struct BoardShape {
    centre_m: Vector2<f64>,
    half_m: Vector2<f64>,
}

impl BoardShape {
    /// Of all corners that any view has.
    pub fn of<'a>(board_m: impl Iterator<Item = &'a [f64; 3]>) -> Self {
        let (mut low, mut high) = (Vector2::repeat(f64::INFINITY), Vector2::repeat(f64::NEG_INFINITY));
        for [x, y, _] in board_m {
            let corner = Vector2::new(*x, *y);
            (low, high) = (low.inf(&corner), high.sup(&corner));
        }
        Self { centre_m: (low + high) / 2.0, half_m: (high - low) / 2.0 }
    }

    /// How the height of a corner follows from the two warps.
    pub fn bend(&self, point: &[f64; 3]) -> Vector2<f64> {
        let at = (Vector2::new(point[0], point[1]) - self.centre_m).component_div(&self.half_m);
        at.map(|v| 1.0 - v * v)
    }

    /// A corner of the bent board.
    pub fn lifted(&self, point: &[f64; 3], warp_m: &Vector2<f64>) -> Vector3<f64> {
        let mut lifted = Vector3::from(*point);
        if *warp_m != Vector2::zeros() {
            lifted.z += self.bend(point).dot(warp_m);
        }
        lifted
    }
}
