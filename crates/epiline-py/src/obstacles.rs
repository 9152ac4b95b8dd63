//! Python face of `epiline::obstacles`.

use epiline::obstacles::{Obstacle, ObstacleParams, find_obstacles};
use epiline::regions::Region;
use pyo3::prelude::*;

use crate::convert::{OrRaise, whole};
use crate::matching::PyDisparityMap;
use crate::rectification::PyRectifiedGeometry;
use crate::regions::{PyRegion, unwrap};

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyObstacle>()?;
    module.add_function(wrap_pyfunction!(py_find_obstacles, module)?)
}

/// Something that stands in the way.
#[pyclass(name = "Obstacle", module = "epiline", frozen, eq)]
#[derive(PartialEq)]
pub struct PyObstacle(pub Obstacle);

#[pymethods]
impl PyObstacle {
    /// Rank in its frame, nearest first, from 0.
    #[getter]
    fn id(&self) -> usize {
        self.0.id
    }

    /// Name of the region it was found in; one that stands in two regions is found twice.
    #[getter]
    fn region(&self) -> &str {
        &self.0.region
    }

    /// x, y, width, height: where it is seen, pixels of the left aligned image.
    #[getter(r#box)]
    fn bounds(&self) -> (usize, usize, usize, usize) {
        let bounds = self.0.bounds;
        (bounds.x, bounds.y, bounds.width, bounds.height)
    }

    /// Euclidean range of its near side, metres.
    #[getter]
    fn range_m(&self) -> f64 {
        self.0.range_m
    }

    /// Z of its near side along the optical axis, metres.
    #[getter]
    fn depth_m(&self) -> f64 {
        self.0.depth_m
    }

    /// Standard deviation of `range_m`, metres.
    #[getter]
    fn sigma_m(&self) -> f64 {
        self.0.sigma_m
    }

    /// Bearing of its near side, radians, positive to the right of the optical axis.
    #[getter]
    fn bearing_rad(&self) -> f64 {
        self.0.bearing_rad
    }

    /// Horizontal extent of its near side across the optical axis, metres.
    #[getter]
    fn width_m(&self) -> f64 {
        self.0.width_m
    }

    /// Vertical extent, metres: no more than its region shows.
    #[getter]
    fn height_m(&self) -> f64 {
        self.0.height_m
    }

    /// Pixels.
    #[getter]
    fn support(&self) -> usize {
        self.0.support
    }

    fn __repr__(&self) -> String {
        let Obstacle { id, region, range_m, sigma_m, bearing_rad, .. } = &self.0;
        format!(
            "Obstacle(id={id}, region='{region}', range_m={range_m:.3}, sigma_m={sigma_m:.3}, bearing_rad={bearing_rad:.3})"
        )
    }
}

/// Finds what stands upright at one distance: supported clusters in u-disparity, nearest first.
///
/// A floor h metres below the camera is no obstacle while h / baseline is less than `min_support`.
///
/// Parameters
/// ----------
/// disparity : DisparityMap
///     Disparities of the left image.
/// geometry : RectifiedGeometry
///     Of the aligned pair, of the map's size.
/// regions : sequence of Region, optional
///     Where to look, each on its own; by default in the whole image, as a region called "image".
/// max_range_m : float, optional
///     Nothing farther is reported; by default nothing whose disparity is less than 3 sigma.
/// min_support : int
///     Pixels that a column must have within 1 px of disparity to see an obstacle there.
/// min_height_m : float
///     Nothing lower is an obstacle, unless it reaches the upper or lower edge of its region.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
///
/// Returns
/// -------
/// list of Obstacle
///
/// Raises
/// ------
/// ValueError
///     A region outside the map, a parameter out of range, or a geometry of another size.
#[pyfunction]
#[pyo3(
    name = "find_obstacles",
    signature = (
        disparity, geometry, *, regions = None, max_range_m = None, min_support = 8, min_height_m = 0.1,
        disparity_sigma_px = 0.25
    )
)]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
fn py_find_obstacles(
    py: Python<'_>,
    disparity: PyRef<'_, PyDisparityMap>,
    geometry: PyRectifiedGeometry,
    regions: Option<Vec<PyRegion>>,
    max_range_m: Option<f64>,
    min_support: i64,
    min_height_m: f64,
    disparity_sigma_px: f64,
) -> PyResult<Vec<PyObstacle>> {
    let params = ObstacleParams {
        min_support: whole("min_support", min_support)?,
        max_range_m,
        min_height_m,
        disparity_sigma_px,
        ..ObstacleParams::default()
    };
    let map = &disparity.inner;
    let regions = regions.map_or_else(|| vec![Region::whole(map.width(), map.height())], unwrap);
    let obstacles = py.detach(|| find_obstacles(map, &geometry.0, &regions, &params)).or_raise()?;
    Ok(obstacles.into_iter().map(PyObstacle).collect())
}
