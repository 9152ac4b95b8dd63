//! Python face of `epiline::obstacles`.

use epiline::ground::{GroundParams, GroundPlane, find_ground};
use epiline::matching::DisparityMap;
use epiline::obstacles::{Obstacle, ObstacleMethod, ObstacleParams, find_obstacles};
use epiline::rectification::RectifiedGeometry;
use epiline::regions::Region;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{OrRaise, whole};
use crate::ground::PyGroundPlane;
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

    /// Name of the first region it stands in.
    #[getter]
    fn region(&self) -> &str {
        &self.0.region
    }

    /// Names of all regions it stands in, in their order.
    #[getter]
    fn regions(&self) -> Vec<&str> {
        self.0.regions.iter().map(|name| &**name).collect()
    }

    /// x, y, width, height: where it is seen, pixels of the left aligned image.
    #[getter(r#box)]
    fn bounds(&self) -> (usize, usize, usize, usize) {
        let bounds = self.0.bounds;
        (bounds.x, bounds.y, bounds.width, bounds.height)
    }

    /// Euclidean range of its nearest point, metres.
    #[getter]
    fn range_m(&self) -> f64 {
        self.0.range_m
    }

    /// Z of its nearest point along the optical axis, metres.
    #[getter]
    fn depth_m(&self) -> f64 {
        self.0.depth_m
    }

    /// Standard deviation of `range_m`, metres.
    #[getter]
    fn sigma_m(&self) -> f64 {
        self.0.sigma_m
    }

    /// Bearing of its nearest point, radians, positive to the right of the optical axis.
    #[getter]
    fn bearing_rad(&self) -> f64 {
        self.0.bearing_rad
    }

    /// Horizontal extent across the optical axis at the depth of its nearest point, metres.
    #[getter]
    fn width_m(&self) -> f64 {
        self.0.width_m
    }

    /// Vertical extent of what is seen of it, metres.
    #[getter]
    fn height_m(&self) -> f64 {
        self.0.height_m
    }

    /// How high its top is over the ground, metres; None without a ground.
    #[getter]
    fn height_above_ground_m(&self) -> Option<f64> {
        self.0.height_above_ground_m
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

/// Where the ground comes from.
#[derive(FromPyObject)]
enum GroundChoice {
    #[pyo3(annotation = "GroundPlane")]
    Given(Py<PyGroundPlane>),
    #[pyo3(annotation = "'auto'")]
    Named(String),
}

impl GroundChoice {
    /// The plane given, or that of the map.
    fn resolve(
        self,
        py: Python<'_>,
        map: &DisparityMap,
        geometry: &RectifiedGeometry,
        disparity_sigma_px: f64,
    ) -> PyResult<Option<GroundPlane>> {
        match self {
            Self::Given(plane) => Ok(Some(plane.get().0)),
            Self::Named(name) if name == "auto" => {
                let params = GroundParams { disparity_sigma_px, ..GroundParams::default() };
                py.detach(|| find_ground(map, geometry, &params)).map(Result::ok).or_raise()
            }
            Self::Named(name) => {
                let message = format!("ground = '{name}': must be 'auto', a GroundPlane or None");
                Err(PyValueError::new_err(message))
            }
        }
    }
}

/// The method of this name.
pub fn method_named(name: &str) -> PyResult<ObstacleMethod> {
    match name {
        "u-disparity" => Ok(ObstacleMethod::UDisparity),
        "paper" => Ok(ObstacleMethod::Paper),
        _ => Err(PyValueError::new_err(format!("method = '{name}': must be 'u-disparity' or 'paper'"))),
    }
}

/// Finds what stands in the way: supported clusters in u-disparity over the ground, nearest first.
///
/// Without a ground, what a column sees upright is an obstacle; a floor h metres below the camera is none while
/// h / baseline is less than `min_support`.
///
/// Parameters
/// ----------
/// disparity : DisparityMap
///     Disparities of the left image.
/// geometry : RectifiedGeometry
///     Of the aligned pair, of the map's size.
/// regions : sequence of Region, optional
///     Only what stands in one of them is reported; by default all, as of a region called "image".
/// method : {"u-disparity", "paper"}
///     "paper" is that of the 2011 paper: clusters of pixels nearer than their neighbourhood, which a Gaussian low-pass of
///     the map stands for (equation 7). It knows no ground.
/// low_pass_sigma : float
///     "paper": sigma of the low-pass, whole periods across the image; a small one makes the neighbourhood large.
/// brighter_px : float
///     "paper": how much nearer than its neighbourhood an obstacle is, px of disparity.
/// ground : GroundPlane or "auto" or None
///     By default found in the map, if there is one; None goes without.
/// max_range_m : float, optional
///     Nothing farther is reported; by default nothing whose disparity is less than 3 sigma.
/// min_support : int
///     Pixels that a column must have within 1 px of disparity to see an obstacle there where no ground is known.
/// min_height_m : float
///     Where no ground is known, nothing lower is an obstacle, unless it reaches the lower edge of the image.
/// step_m : float
///     What rises less over the ground can be driven over, metres.
/// headroom_m : float
///     What hangs higher over the ground can be passed under, metres.
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
        disparity, geometry, *, regions = None, method = "u-disparity", low_pass_sigma = 3.0, brighter_px = 1.0,
        ground = Some(GroundChoice::Named("auto".into())), max_range_m = None, min_support = 8, min_height_m = 0.3,
        step_m = 0.05, headroom_m = 2.0, disparity_sigma_px = 0.25
    ),
    text_signature = "(disparity, geometry, *, regions=None, method='u-disparity', low_pass_sigma=3.0, brighter_px=1.0, ground='auto', max_range_m=None, min_support=8, min_height_m=0.3, step_m=0.05, headroom_m=2.0, disparity_sigma_px=0.25)"
)]
#[expect(clippy::too_many_arguments, reason = "keywords in Python")]
fn py_find_obstacles(
    py: Python<'_>,
    disparity: PyRef<'_, PyDisparityMap>,
    geometry: PyRectifiedGeometry,
    regions: Option<Vec<PyRegion>>,
    method: &str,
    low_pass_sigma: f64,
    brighter_px: f64,
    ground: Option<GroundChoice>,
    max_range_m: Option<f64>,
    min_support: i64,
    min_height_m: f64,
    step_m: f64,
    headroom_m: f64,
    disparity_sigma_px: f64,
) -> PyResult<Vec<PyObstacle>> {
    let params = ObstacleParams {
        method: method_named(method)?,
        low_pass_sigma,
        brighter_px,
        min_support: whole("min_support", min_support)?,
        max_range_m,
        min_height_m,
        step_m,
        headroom_m,
        disparity_sigma_px,
        ..ObstacleParams::default()
    };
    params.validate().or_raise()?;
    let map = &disparity.inner;
    let regions = regions.map_or_else(|| vec![Region::whole(map.width(), map.height())], unwrap);
    let ground = match ground {
        Some(choice) if params.method == ObstacleMethod::UDisparity => {
            choice.resolve(py, map, &geometry.0, disparity_sigma_px)?
        }
        _ => None,
    };
    let find = || find_obstacles(map, &geometry.0, ground.as_ref(), &regions, &params);
    Ok(py.detach(find).or_raise()?.into_iter().map(PyObstacle).collect())
}
