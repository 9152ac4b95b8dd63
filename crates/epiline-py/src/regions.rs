//! Python face of `epiline::regions`.

use epiline::regions::{
    CameraOverGround, NearestSurface, ProfileParams, Region, RegionProfile, Search, Slab, paper_regions,
    profile,
};
use numpy::PyArray1;
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;

use crate::convert::{OrRaise, whole};
use crate::matching::PyDisparityMap;
use crate::rectification::PyRectifiedGeometry;

/// Adds this part to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyCameraOverGround>()?;
    module.add_class::<PySlab>()?;
    module.add_class::<PyRegion>()?;
    module.add_class::<PyRegionProfile>()?;
    module.add_function(wrap_pyfunction!(py_paper_regions, module)?)?;
    module.add_function(wrap_pyfunction!(py_profile, module)?)
}

/// How the left aligned camera stands over level ground.
///
/// Angles are those of REP 103's body frame (x forward, y left, z up): turned by `roll_rad` about x, then by `pitch_rad`
/// about y.
///
/// Parameters
/// ----------
/// height_m : float
///     Height of the camera's centre above the ground, metres.
/// pitch_rad : float
///     Positive looks down.
/// roll_rad : float
///     Positive lowers the right side.
///
/// Raises
/// ------
/// ValueError
///     A height that is not positive, an angle of a right angle or more.
#[pyclass(name = "CameraOverGround", module = "epiline", frozen, eq, from_py_object)]
#[derive(Clone, Copy, PartialEq)]
pub struct PyCameraOverGround(pub CameraOverGround);

#[pymethods]
impl PyCameraOverGround {
    #[new]
    #[pyo3(signature = (height_m, *, pitch_rad = 0.0, roll_rad = 0.0))]
    fn new(height_m: f64, pitch_rad: f64, roll_rad: f64) -> PyResult<Self> {
        let camera = CameraOverGround { height_m, pitch_rad, roll_rad };
        camera.validate().map(|()| Self(camera)).or_raise()
    }

    /// Metres above the ground.
    #[getter]
    fn height_m(&self) -> f64 {
        self.0.height_m
    }

    /// Radians, positive looks down.
    #[getter]
    fn pitch_rad(&self) -> f64 {
        self.0.pitch_rad
    }

    /// Radians, positive lowers the right side.
    #[getter]
    fn roll_rad(&self) -> f64 {
        self.0.roll_rad
    }

    fn __repr__(&self) -> String {
        let CameraOverGround { height_m, pitch_rad, roll_rad } = self.0;
        format!("CameraOverGround({height_m}, pitch_rad={pitch_rad}, roll_rad={roll_rad})")
    }
}

/// A part of space ahead of the rig: a layer over the ground between two ranges, of some width or any.
///
/// Parameters
/// ----------
/// height_m : (float, float)
///     Lowest and highest point above the ground, metres; either end may be infinite.
/// range_m : (float, float)
///     Nearest and furthest Euclidean range from the left camera, metres; the furthest may be infinite.
/// lateral_m : (float, float), optional
///     Leftmost and rightmost, metres; positive is to the right of the camera. Any by default.
///
/// Raises
/// ------
/// ValueError
///     A pair that is not in ascending order, or a nearest range that is not positive.
#[pyclass(name = "Slab", module = "epiline", frozen, eq, from_py_object)]
#[derive(Clone, Copy, PartialEq)]
pub struct PySlab(pub Slab);

#[pymethods]
impl PySlab {
    #[new]
    #[pyo3(signature = (*, height_m, range_m, lateral_m = None))]
    fn new(height_m: (f64, f64), range_m: (f64, f64), lateral_m: Option<(f64, f64)>) -> PyResult<Self> {
        let any = Slab::new(height_m, range_m);
        let slab = Slab { lateral_m: lateral_m.unwrap_or(any.lateral_m), ..any };
        slab.validate().map(|()| Self(slab)).or_raise()
    }

    /// Lowest and highest point above the ground, metres.
    #[getter]
    fn height_m(&self) -> (f64, f64) {
        self.0.height_m
    }

    /// Nearest and furthest Euclidean range, metres.
    #[getter]
    fn range_m(&self) -> (f64, f64) {
        self.0.range_m
    }

    /// Leftmost and rightmost, metres; infinite where the slab does not end.
    #[getter]
    fn lateral_m(&self) -> (f64, f64) {
        self.0.lateral_m
    }

    fn __repr__(&self) -> String {
        let Slab { height_m, range_m, lateral_m } = self.0;
        format!("Slab(height_m={height_m:?}, range_m={range_m:?}, lateral_m={lateral_m:?})")
    }
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

    /// The part of an image between shares of its width and height.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     What results call it.
    /// x, y, width, height : float
    ///     Shares of the image, 0 to 1; edges are rounded to the nearest pixel.
    /// image_size : (int, int)
    ///     Width and height of the image, px.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     A share outside 0 to 1, or a box without a pixel.
    #[staticmethod]
    #[pyo3(signature = (name, *, x, y, width, height, image_size))]
    fn from_shares(
        name: &str,
        x: f64,
        y: f64,
        width: f64,
        height: f64,
        image_size: (i64, i64),
    ) -> PyResult<Self> {
        let (image_width, image_height) =
            (whole("image_size[0]", image_size.0)?, whole("image_size[1]", image_size.1)?);
        Region::from_shares(name, [x, y, width, height], image_width, image_height).map(Self).or_raise()
    }

    /// The pixels that see a part of space, and the disparities of points in it.
    ///
    /// Parameters
    /// ----------
    /// name : str
    ///     What results call it.
    /// slab : Slab
    ///     Which part of space.
    /// camera : CameraOverGround
    ///     How the left aligned camera stands.
    /// geometry : RectifiedGeometry
    ///     Projects one to the other.
    ///
    /// Returns
    /// -------
    /// Region
    ///     Its box holds every pixel that a point of the slab falls on, and no row or column more than one beyond those;
    ///     its disparities are those of all points of the slab and one pixel beyond. A profile of it reads only pixels
    ///     whose points lie in the slab.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     No pixel sees the slab, or the pair is cylindrical.
    #[staticmethod]
    fn in_space(
        py: Python<'_>,
        name: &str,
        slab: PySlab,
        camera: PyCameraOverGround,
        geometry: PyRectifiedGeometry,
    ) -> PyResult<Self> {
        py.detach(|| Region::in_space(name, slab.0, camera.0, &geometry.0)).map(Self).or_raise()
    }

    /// The part of space it was made from; None for a box of pixels.
    #[getter]
    fn slab(&self) -> Option<PySlab> {
        self.0.space.map(|space| PySlab(space.slab))
    }

    /// How the camera stood that it was made for; None for a box of pixels.
    #[getter]
    fn camera(&self) -> Option<PyCameraOverGround> {
        self.0.space.map(|space| PyCameraOverGround(space.camera))
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
        let Region { name, x, y, width, height, search, .. } = &self.0;
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

    /// (W,) float32: 1.4826 times the median distance from the median of each column.
    #[getter]
    fn spread_px<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_slice(py, &self.0.spread_px)
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

    /// (W,) uint32: pixels of each column that carry none. In a region of space (`region.slab`) the two need not make up
    /// the column: a known point outside the slab is neither.
    #[getter]
    fn unknown<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<u32>> {
        PyArray1::from_slice(py, &self.0.unknown)
    }

    /// (W,) float32: share of each column's pixels that carry no value, 0 to 1.
    #[getter]
    fn unknown_share<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray1<f32>> {
        PyArray1::from_iter(py, self.0.unknown_shares())
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
