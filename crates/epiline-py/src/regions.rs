//! Python face of `epiline::regions`.

use epiline::regions::{
    NearestSurface, ProfileParams, Region, RegionProfile, Search, paper_regions, profile,
};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{OrRaise, whole};
use crate::matching::PyDisparityMap;
use crate::rectification::PyRectifiedGeometry;

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyRegion>()?;
    module.add_class::<PyRegionProfile>()?;
    module.add_function(wrap_pyfunction!(py_paper_regions, module)?)?;
    module.add_function(wrap_pyfunction!(py_profile, module)?)
}

/// A named box of pixels of the left aligned image: columns x to x + width - 1, rows y to y + height - 1.
///
/// Parameters
/// ----------
/// name : str
///     What results call it.
/// x, y, width, height : int
///     Pixels.
/// disparities : (int, int), optional
///     What a matcher that is given this region searches: the smallest disparity and how many, px.
/// range_m : (float, float), optional
///     The same as Euclidean ranges, nearest and furthest, metres; the matcher then needs the geometry. The furthest may be
///     infinite. Without either, the matcher's own range of disparities.
///
/// Raises
/// ------
/// ValueError
///     A negative number, or both `disparities` and `range_m`. Whether the box lies inside an image is checked when it is
///     used.
#[pyclass(name = "Region", module = "epiline", frozen, eq, from_py_object)]
#[derive(Clone, PartialEq)]
pub struct PyRegion(pub Region);

#[pymethods]
impl PyRegion {
    #[new]
    #[pyo3(signature = (name, *, x, y, width, height, disparities = None, range_m = None))]
    fn new(
        name: &str,
        x: i64,
        y: i64,
        width: i64,
        height: i64,
        disparities: Option<(i64, i64)>,
        range_m: Option<(f64, f64)>,
    ) -> PyResult<Self> {
        let (x, y) = (whole("x", x)?, whole("y", y)?);
        let search = match (disparities, range_m) {
            (None, None) => None,
            (Some((first, count)), None) => Some(Search::Disparities {
                first: whole("disparities[0]", first)?,
                count: whole("disparities[1]", count)?,
            }),
            (None, Some((near_m, far_m))) => Some(Search::Range { near_m, far_m }),
            (Some(_), Some(_)) => {
                let message = format!("region '{name}': give either disparities or range_m, not both");
                return Err(PyValueError::new_err(message));
            }
        };
        let region = Region::new(name, x, y, whole("width", width)?, whole("height", height)?);
        Ok(Self(Region { search, ..region }))
    }

    /// What results call it.
    #[getter]
    fn name(&self) -> &str {
        &self.0.name
    }

    /// Leftmost column.
    #[getter]
    fn x(&self) -> usize {
        self.0.x
    }

    /// Topmost row.
    #[getter]
    fn y(&self) -> usize {
        self.0.y
    }

    /// Columns.
    #[getter]
    fn width(&self) -> usize {
        self.0.width
    }

    /// Rows.
    #[getter]
    fn height(&self) -> usize {
        self.0.height
    }

    /// (first, count) of the disparities searched, px; None if not given.
    #[getter]
    fn disparities(&self) -> Option<(usize, usize)> {
        match self.0.search {
            Some(Search::Disparities { first, count }) => Some((first, count)),
            _ => None,
        }
    }

    /// (nearest, furthest) Euclidean range searched, metres; None if not given.
    #[getter]
    fn range_m(&self) -> Option<(f64, f64)> {
        match self.0.search {
            Some(Search::Range { near_m, far_m }) => Some((near_m, far_m)),
            _ => None,
        }
    }

    fn __repr__(&self) -> String {
        let Region { name, x, y, width, height, search } = &self.0;
        let search = match search {
            None => String::new(),
            Some(Search::Disparities { first, count }) => format!(", disparities=({first}, {count})"),
            Some(Search::Range { near_m, far_m }) => format!(", range_m=({near_m}, {far_m})"),
        };
        format!("Region('{name}', x={x}, y={y}, width={width}, height={height}{search})")
    }
}

/// The core's regions.
pub fn unwrap(regions: Vec<PyRegion>) -> Vec<Region> {
    regions.into_iter().map(|region| region.0).collect()
}

/// The 2011 paper's four bands, 320x20 to 320x50 px of a 320x240 image, scaled to an image of this size.
///
/// They stand on top of each other without overlap and end at the lower edge: "band_20" straddles the middle row,
/// then follow "band_30", "band_40" and "band_50".
///
/// Raises
/// ------
/// ValueError
///     An image without columns or of fewer than 12 rows.
#[pyfunction]
#[pyo3(name = "paper_regions")]
fn py_paper_regions(width: i64, height: i64) -> PyResult<Vec<PyRegion>> {
    let regions = paper_regions(whole("width", width)?, whole("height", height)?).or_raise()?;
    Ok(regions.into_iter().map(PyRegion).collect())
}

/// A region read column by column and as a whole.
///
/// Per column arrays have `region.width` entries; columns without support are NaN. Disparities are in pixels.
#[pyclass(name = "RegionProfile", module = "epiline", frozen)]
pub struct PyRegionProfile(pub RegionProfile);

impl PyRegionProfile {
    fn nearest(&self, of: impl Fn(&NearestSurface) -> f64) -> f64 {
        self.0.nearest.as_ref().map_or(f64::NAN, of)
    }
}

#[pymethods]
impl PyRegionProfile {
    /// Where.
    #[getter]
    fn region(&self) -> PyRegion {
        PyRegion(self.0.region.clone())
    }

    /// (W,) float32: largest disparity of each column that enough pixels lie within 1 px of.
    #[getter]
    fn nearest_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.nearest_px)
    }

    /// (W,) float32: median of each column.
    #[getter]
    fn median_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.median_px)
    }

    /// (W,) float32: smallest of each column.
    #[getter]
    fn minimum_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.minimum_px)
    }

    /// (W,) float32: largest of each column, supported or not.
    #[getter]
    fn maximum_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.maximum_px)
    }

    /// (W,) uint32: pixels of each column that carry a value.
    #[getter]
    fn count<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.0.count)
    }

    /// (W,) float32: Euclidean range of `nearest_px`, metres; None without geometry.
    #[getter]
    fn nearest_range_m<'py>(&self, py: Python<'py>) -> Option<Bound<'py, PyArray1<f32>>> {
        self.0.nearest_range_m.as_ref().map(|ranges_m| PyArray1::from_slice(py, ranges_m))
    }

    /// (B,) uint32: entry i counts the pixels whose disparity rounds to i px.
    #[getter]
    fn histogram<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.0.histogram)
    }

    /// Share of pixels that carry a value, 0 to 1.
    #[getter]
    fn valid_share(&self) -> f64 {
        self.0.valid_share
    }

    /// Smallest disparity, px; NaN without a value.
    #[getter]
    fn minimum(&self) -> f64 {
        self.0.minimum
    }

    /// Largest disparity, px; NaN without a value.
    #[getter]
    fn maximum(&self) -> f64 {
        self.0.maximum
    }

    /// Sum of all disparities, px: the paper's total of pixel values.
    #[getter]
    fn total(&self) -> f64 {
        self.0.total
    }

    /// Euclidean range of the nearest surface with enough support, metres; NaN without one, or without geometry.
    #[getter]
    fn range_m(&self) -> f64 {
        self.nearest(|surface| surface.range_m)
    }

    /// Standard deviation of `range_m`, metres.
    #[getter]
    fn sigma_m(&self) -> f64 {
        self.nearest(|surface| surface.sigma_m)
    }

    /// Disparity of the nearest surface's nearest point, px; NaN without one.
    #[getter]
    fn nearest_disparity_px(&self) -> f64 {
        self.nearest(|surface| surface.disparity_px)
    }

    /// (x, y) of that point, pixels of the left aligned image; None without one.
    #[getter]
    fn nearest_at(&self) -> Option<(usize, usize)> {
        self.0.nearest.as_ref().map(|surface| surface.at)
    }

    /// Pixels of the nearest surface.
    #[getter]
    fn support(&self) -> usize {
        self.0.nearest.as_ref().map_or(0, |surface| surface.support)
    }

    fn __repr__(&self) -> String {
        let (name, range_m, sigma_m) = (&self.0.region.name, self.range_m(), self.sigma_m());
        format!("RegionProfile('{name}', range_m={range_m:.3}, sigma_m={sigma_m:.3})")
    }
}

/// Reads regions of a disparity map: value against column, and the figures of each region.
///
/// Parameters
/// ----------
/// disparity : DisparityMap
///     Disparities of the left image.
/// regions : sequence of Region
///     Any number, any size inside the map; they may overlap.
/// geometry : RectifiedGeometry, optional
///     Turns disparities into metres.
/// min_support : int
///     A column's nearest disparity counts only if at least this many of its pixels lie within 1 px of it; a region's
///     nearest surface needs ten times as many among neighbouring columns.
/// disparity_sigma_px : float
///     Standard deviation of a disparity, px.
///
/// Returns
/// -------
/// list of RegionProfile
///
/// Raises
/// ------
/// ValueError
///     A region outside the map, a parameter out of range, or a geometry of another size.
#[pyfunction]
#[pyo3(
    name = "profile",
    signature = (disparity, regions, *, geometry = None, min_support = 3, disparity_sigma_px = 0.25)
)]
fn py_profile(
    py: Python<'_>,
    disparity: PyRef<'_, PyDisparityMap>,
    regions: Vec<PyRegion>,
    geometry: Option<PyRectifiedGeometry>,
    min_support: i64,
    disparity_sigma_px: f64,
) -> PyResult<Vec<PyRegionProfile>> {
    let params = ProfileParams { min_support: whole("min_support", min_support)?, disparity_sigma_px };
    let (map, regions) = (&disparity.inner, unwrap(regions));
    let geometry = geometry.map(|geometry| geometry.0);
    let profiles = py.detach(|| profile(map, &regions, geometry.as_ref(), &params)).or_raise()?;
    Ok(profiles.into_iter().map(PyRegionProfile).collect())
}
