//! Matching: `DisparityMap` and `StereoMatcher`.

use std::sync::{Mutex, PoisonError};

use epiline::image::Image;
use epiline::matching::{
    DisparityMap, MatchRegion, MatcherParams, Method, Prefilter, Preset, StereoMatcher, Subpixel, Validity,
};
use numpy::{PyArray1, PyArray2, PyArrayMethods};
use pyo3::exceptions::{PyTypeError, PyValueError};
use pyo3::prelude::*;
use pyo3::types::PyDict;

use crate::convert::{OrRaise, Pixels, grey_image, image_array, mask_image, typed_image, whole};
use crate::rectification::PyRectifiedGeometry;
use crate::regions::PyRegion;

/// Disparities of the left image, and per pixel the reasons it has none.
///
/// Parameters
/// ----------
/// raw : (H, W) uint16
///     Disparity in 1/16 px.
/// validity : (H, W) uint8
///     Reasons, OR-ed: 1 border, 2 no source, 4 not unique, 8 left-right, 16 low texture, 32 speckle, 64 saturated;
///     128 filled, which is a remark and no rejection.
/// min_disparity, num_disparities : int
///     The range searched, px.
#[pyclass(name = "DisparityMap", module = "epiline")]
pub struct PyDisparityMap {
    /// The map itself.
    pub inner: DisparityMap,
}

fn owned<T: numpy::Element + Copy + Default>(
    name: &'static str,
    pixels: &Pixels<'_, T>,
) -> PyResult<Image<T>> {
    let view = pixels.view();
    Image::from_vec(name, view.rows().flatten().copied().collect(), view.width(), view.height()).or_raise()
}

#[pymethods]
impl PyDisparityMap {
    #[new]
    #[pyo3(signature = (raw, validity, *, min_disparity = 0, num_disparities = 64))]
    fn new(
        raw: &Bound<'_, PyAny>,
        validity: &Bound<'_, PyAny>,
        min_disparity: i64,
        num_disparities: i64,
    ) -> PyResult<Self> {
        let raw = owned("raw", &typed_image::<u16>("raw", raw, "uint16")?)?;
        let validity = owned("validity", &typed_image::<u8>("validity", validity, "uint8")?)?;
        let min_disparity = whole("min_disparity", min_disparity)?;
        let num_disparities = whole("num_disparities", num_disparities)?;
        Ok(Self {
            inner: DisparityMap::from_parts(raw, validity, min_disparity, num_disparities).or_raise()?,
        })
    }

    /// (H, W) float32: disparity, px; NaN where there is none. A new array at each access.
    #[getter]
    fn values<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        image_array(py, &self.inner.to_f32())
    }

    /// (H, W) uint16: disparity, 1/16 px, also where it was rejected. A new array at each access.
    #[getter]
    fn raw<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u16>> {
        image_array(py, &self.inner.values)
    }

    /// (H, W) uint8: reasons for rejection, OR-ed. A new array at each access.
    #[getter]
    fn validity<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<u8>> {
        image_array(py, &self.inner.validity)
    }

    /// Smallest disparity searched, px.
    #[getter]
    fn min_disparity(&self) -> usize {
        self.inner.min_disparity
    }

    /// How many whole disparities were searched.
    #[getter]
    fn num_disparities(&self) -> usize {
        self.inner.num_disparities
    }

    /// Share of pixels that have a value, 0 to 1.
    #[getter]
    fn density(&self) -> f64 {
        self.inner.density()
    }

    /// (H, W) float32: how far a disparity can be trusted, 0 to 1, NaN where there is none. Computed at each access.
    ///
    /// From the map alone: how well a disparity continues those around it, and how close rejected pixels are. It orders
    /// pixels by the error to be expected, for any method, and is no probability. Filled pixels have a confidence of 0.
    #[getter]
    fn confidence<'py>(&self, py: Python<'py>) -> Bound<'py, PyArray2<f32>> {
        let map = &self.inner;
        let confidence = py.detach(|| map.confidence());
        let values = map.validity.as_slice().iter().zip(confidence.as_slice()).map(|(&bits, &confidence)| {
            if Validity::has_value(bits) { f32::from(confidence) / 255.0 } else { f32::NAN }
        });
        PyArray1::from_iter(py, values)
            .reshape([map.height(), map.width()])
            .expect("a map has height x width pixels")
    }

    /// (H, W).
    #[getter]
    fn shape(&self) -> (usize, usize) {
        (self.inner.height(), self.inner.width())
    }

    /// OpenCV's representation.
    ///
    /// Returns
    /// -------
    /// (H, W) int16
    ///     16 times the disparity; 16 times (min_disparity - 1) where there is none.
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     The range exceeds 2048 px.
    fn to_opencv<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyArray2<i16>>> {
        Ok(image_array(py, &self.inner.to_opencv().or_raise()?))
    }

    fn __repr__(&self) -> String {
        let map = &self.inner;
        let end = map.min_disparity + map.num_disparities;
        format!(
            "DisparityMap({}x{} px, disparities {} to {} px, density {:.3})",
            map.width(),
            map.height(),
            map.min_disparity,
            end.saturating_sub(1),
            map.density()
        )
    }
}

fn method_named(name: &str) -> PyResult<Method> {
    Method::ALL.into_iter().find(|method| method.name() == name).ok_or_else(|| {
        let expected = "must be 'sad', 'sad5', 'census', 'bt' or 'sgm'";
        PyValueError::new_err(format!("method = '{name}': {expected}"))
    })
}

fn preset_named(name: &str) -> PyResult<Preset> {
    Preset::ALL.into_iter().find(|preset| preset.name() == name).ok_or_else(|| {
        let expected = "must be 'fast', 'balanced' or 'accurate'";
        PyValueError::new_err(format!("preset = '{name}': {expected}"))
    })
}

/// Parameters by name: those given change the preset's, or the method's defaults.
fn params_from(given: Option<&Bound<'_, PyDict>>) -> PyResult<MatcherParams> {
    let Some(given) = given else {
        return Ok(MatcherParams::default());
    };
    let text = |name: &str| -> PyResult<Option<String>> {
        given.get_item(name)?.filter(|value| !value.is_none()).map(|value| value.extract()).transpose()
    };
    let method = text("method")?.as_deref().map(method_named).transpose()?;
    let mut params = match text("preset")? {
        Some(preset) => preset_named(&preset)?.params(),
        None => MatcherParams::for_method(method.unwrap_or_default()),
    };
    params.method = method.unwrap_or(params.method);
    for (name, value) in given {
        set(&mut params, &name.extract::<String>()?, &value)?;
    }
    Ok(params)
}

/// Sets one parameter.
fn set(params: &mut MatcherParams, name: &str, value: &Bound<'_, PyAny>) -> PyResult<()> {
    fn count<T: TryFrom<i64>>(name: &'static str, value: &Bound<'_, PyAny>) -> PyResult<T> {
        whole(name, value.extract()?)
    }
    fn optional<T: TryFrom<i64>>(name: &'static str, value: &Bound<'_, PyAny>) -> PyResult<Option<T>> {
        value.extract::<Option<i64>>()?.map(|value| whole(name, value)).transpose()
    }
    match name {
        "preset" | "method" | "regions" | "geometry" => {}
        "num_disparities" => params.num_disparities = count("num_disparities", value)?,
        "min_disparity" => params.min_disparity = count("min_disparity", value)?,
        "block_size" => params.block_size = count("block_size", value)?,
        "threads" => params.threads = optional("threads", value)?,
        "prefilter" => params.prefilter = prefilter_named(value.extract::<Option<String>>()?.as_deref())?,
        "prefilter_cap" => params.prefilter_cap = count("prefilter_cap", value)?,
        "uniqueness_ratio" => params.uniqueness_ratio = count("uniqueness_ratio", value)?,
        "texture_threshold" => params.texture_threshold = count("texture_threshold", value)?,
        "left_right_max_diff" => params.left_right_max_diff = optional("left_right_max_diff", value)?,
        "speckle_size" => params.speckle_size = count("speckle_size", value)?,
        "speckle_range" => params.speckle_range = count("speckle_range", value)?,
        "subpixel" => params.subpixel = subpixel_named(value)?,
        "coarse_weight" => params.coarse_weight = count("coarse_weight", value)?,
        "fill" => params.fill = value.extract()?,
        "smooth" => params.smooth = value.extract()?,
        "paths" => params.paths = count("paths", value)?,
        "p1" => params.p1 = count("p1", value)?,
        "p2" => params.p2 = count("p2", value)?,
        "saturation_threshold" => params.saturation_threshold = count("saturation_threshold", value)?,
        unknown => {
            let message = format!("StereoMatcher() got an unexpected keyword argument '{unknown}'");
            return Err(PyTypeError::new_err(message));
        }
    }
    Ok(())
}

/// True is the default fit, False none; the fits have names, too.
fn subpixel_named(value: &Bound<'_, PyAny>) -> PyResult<Subpixel> {
    if let Ok(is_on) = value.extract::<bool>() {
        return Ok(if is_on { Subpixel::default() } else { Subpixel::Off });
    }
    match value.extract::<String>().as_deref() {
        Ok("v") => Ok(Subpixel::VFit),
        Ok("parabola") => Ok(Subpixel::Parabola),
        _ => {
            let message = format!("subpixel = {}: must be True, False, 'v' or 'parabola'", value.repr()?);
            Err(PyValueError::new_err(message))
        }
    }
}

/// Boxes to match from a sequence of `Region` and of (x, y, width, height).
fn match_regions(
    regions: &Bound<'_, PyAny>,
    geometry: Option<&PyRectifiedGeometry>,
) -> PyResult<Vec<MatchRegion>> {
    let refuse = |given: &Bound<'_, PyAny>| {
        let given = given.repr().map_or_else(|_| "an object".to_owned(), |text| text.to_string());
        let expected = "must be a sequence of epiline.Region or (x, y, width, height), whole numbers";
        PyValueError::new_err(format!("regions: got {given}: {expected}"))
    };
    let items = regions.extract::<Vec<Bound<'_, PyAny>>>().map_err(|_| refuse(regions))?;
    items
        .into_iter()
        .map(|item| {
            if let Ok(region) = item.extract::<PyRegion>() {
                return region.0.to_match(geometry.map(|geometry| &geometry.0)).or_raise();
            }
            let [x, y, width, height] = item.extract::<[i64; 4]>().map_err(|_| refuse(&item))?;
            Ok(MatchRegion {
                x: whole("regions: x", x)?,
                y: whole("regions: y", y)?,
                width: whole("regions: width", width)?,
                height: whole("regions: height", height)?,
                disparities: None,
            })
        })
        .collect()
}

fn prefilter_named(name: Option<&str>) -> PyResult<Prefilter> {
    match name {
        Some("xsobel") => Ok(Prefilter::XSobel),
        Some("none") | None => Ok(Prefilter::None),
        Some(other) => {
            let message = format!("prefilter = '{other}': must be 'xsobel', 'none' or None");
            Err(PyValueError::new_err(message))
        }
    }
}

/// Matches aligned pairs; keeps its buffers from call to call.
///
/// `method="sad"`: sum of absolute differences over a square window, equation 5 of the 2011 paper. `"sad5"`: over the
/// window around the pixel and the best two of four around its corners (Hirschmueller, Innocent and Garibaldi 2002), which
/// keeps to the edges of objects. `"census"`: Hamming distance of the 5x5 census (Zabih and Woodfill 1994), summed over a
/// window; indifferent to exposure. `"bt"`: differences insensitive to sampling (Birchfield and Tomasi 1998), of the
/// prefiltered image and a quarter of those of grey values, summed over a window; the least disturbed by noise, but both
/// cameras must be equally exposed. `"sgm"`: semi-global matching (Hirschmueller 2008) on the latter two together. In each, windows
/// are clamped to the image and a pixel near the left edge has fewer candidates, not none. Of equal costs the larger
/// disparity wins, as in OpenCV. The result depends neither on `threads` nor on the instruction set.
///
/// Parameters
/// ----------
/// preset : {"fast", "balanced", "accurate"}, optional
///     A measured combination of the parameters below, but for the range of disparities; those given change it. "fast"
///     is sad with coarse costs, "balanced" and "accurate" are sgm, each with its tests.
/// method : {"sad", "sad5", "census", "bt", "sgm"}
///     How pixels are matched.
/// num_disparities : int
///     How many whole disparities to search, 1 to 1024: at least focal length x baseline / nearest depth.
/// block_size : int
///     Side of the window, odd, 1 to 31 px; 1 to 15 px for sgm. If not given: sad 15, sad5 9 (each of its windows),
///     census and bt 11, sgm 3. In large windows of sad5 and bt differences of pixels are truncated, at
///     65534 / (3 block_size^2) and 65534 / block_size^2 grey levels: with the prefilter's default from 19 and 23 px on.
/// min_disparity : int
///     Smallest disparity, px. With num_disparities not more than the image's width.
/// threads : int, optional
///     None is all cores; the environment's EPILINE_THREADS caps either.
/// prefilter : {"xsobel", "none"} or None
///     "xsobel" is insensitive to exposure; none compares grey values, as the paper does and census in any case.
/// prefilter_cap : int
///     Derivatives are clipped to plus or minus this, 1 to 63 grey levels; 15 for sgm, 31 for the others if not
///     given.
/// uniqueness_ratio : int
///     Reject unless candidates beyond the best and its neighbours cost this many percent more; 0 is off.
/// texture_threshold : int
///     Reject windows whose sum of absolute x-Sobel is below this; 0 is off.
/// left_right_max_diff : int, optional
///     Reject where the right image's own best match differs by more than this many px; None is off.
/// speckle_size : int
///     Reject islands of at most this many pixels; 0 is off.
/// speckle_range : int
///     Neighbours within this many px hang together.
/// subpixel : bool or {"v", "parabola"}
///     Refine to 1/16 px from the costs of both neighbours: by two lines of equal and opposite slope ("v", the
///     equiangular fit, which True means too) or by a parabola.
/// coarse_weight : int
///     sad: add semi-global costs from half the resolution with this weight, 0 (off) to 25 percent; they guide windows
///     with little texture of their own. Try 4.
/// fill : bool
///     Answer everywhere: what has no value takes the smaller of its row's nearest values, marked as filled; then a 3x3
///     median and, there and at steps of disparity, a median weighted by the likeness of grey values.
/// smooth : bool
///     Smooth surfaces, but not across steps of more than 2 px nor edges of the image. On in "accurate".
/// paths : {3, 4}
///     sgm: from the left, the right and above; 4: from below too, which needs 2 x width x height x num_disparities bytes.
/// p1 : int
///     sgm: penalty for steps of one disparity, 0 to 127.
/// p2 : int
///     sgm: penalty for larger steps between equal grey values, p1 to 127; it falls where grey values differ.
/// saturation_threshold : int
///     Reject windows of the left image of which at least this many percent are at 0 or 255; 0 is off.
/// regions : sequence of Region or (x, y, width, height), optional
///     Match these boxes only, each with its own range where a Region has one. Inside them the answers are exactly those
///     of the whole image; outside there are none (border). A pixel in several boxes has the range of the first. With
///     all methods but sgm the cost follows the area; sgm, `coarse_weight`, `fill` and `smooth` need the whole image all
///     the same. A Pipeline does not use them.
/// geometry : RectifiedGeometry, optional
///     For regions with a `range_m`.
///
/// Raises
/// ------
/// ValueError
///     A parameter is outside its range.
#[pyclass(name = "StereoMatcher", module = "epiline", frozen)]
pub struct PyStereoMatcher {
    params: MatcherParams,
    regions: Option<Py<PyAny>>,
    geometry: Option<PyRectifiedGeometry>,
    inner: Mutex<StereoMatcher>,
}

impl PyStereoMatcher {
    /// What it was made with.
    pub fn params(&self) -> MatcherParams {
        self.params
    }
}

/// Every parameter of a matcher, by the name Python gives it with.
pub fn parameters_dict<'py>(py: Python<'py>, params: &MatcherParams) -> PyResult<Bound<'py, PyDict>> {
    let dict = PyDict::new(py);
    dict.set_item("method", params.method.name())?;
    dict.set_item("num_disparities", params.num_disparities)?;
    dict.set_item("block_size", params.block_size)?;
    dict.set_item("min_disparity", params.min_disparity)?;
    dict.set_item("threads", params.threads)?;
    let prefilter = match params.prefilter {
        Prefilter::None => "none",
        Prefilter::XSobel => "xsobel",
    };
    dict.set_item("prefilter", prefilter)?;
    dict.set_item("prefilter_cap", params.prefilter_cap)?;
    dict.set_item("uniqueness_ratio", params.uniqueness_ratio)?;
    dict.set_item("texture_threshold", params.texture_threshold)?;
    dict.set_item("left_right_max_diff", params.left_right_max_diff)?;
    dict.set_item("speckle_size", params.speckle_size)?;
    dict.set_item("speckle_range", params.speckle_range)?;
    match params.subpixel {
        Subpixel::Off => dict.set_item("subpixel", false)?,
        Subpixel::VFit => dict.set_item("subpixel", true)?,
        Subpixel::Parabola => dict.set_item("subpixel", "parabola")?,
    }
    dict.set_item("coarse_weight", params.coarse_weight)?;
    dict.set_item("fill", params.fill)?;
    dict.set_item("smooth", params.smooth)?;
    dict.set_item("paths", params.paths)?;
    dict.set_item("p1", params.p1)?;
    dict.set_item("p2", params.p2)?;
    dict.set_item("saturation_threshold", params.saturation_threshold)?;
    Ok(dict)
}

#[pymethods]
impl PyStereoMatcher {
    #[new]
    #[pyo3(signature = (**parameters), text_signature = "(*, preset=None, method='sad', num_disparities=64, \
        block_size=..., min_disparity=0, threads=None, prefilter='xsobel', prefilter_cap=..., uniqueness_ratio=0, \
        texture_threshold=0, left_right_max_diff=None, speckle_size=0, speckle_range=2, subpixel=True, \
        coarse_weight=0, fill=False, smooth=False, paths=4, p1=48, p2=127, saturation_threshold=0, regions=None, \
        geometry=None)")]
    fn new(parameters: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let params = params_from(parameters)?;
        let given = |name: &str| -> PyResult<Option<Bound<'_, PyAny>>> {
            let item = parameters.map(|given| given.get_item(name)).transpose()?.flatten();
            Ok(item.filter(|value| !value.is_none()))
        };
        let geometry = match given("geometry")? {
            Some(geometry) => Some(geometry.extract::<PyRectifiedGeometry>()?),
            None => None,
        };
        let regions = given("regions")?;
        if let Some(regions) = &regions {
            match_regions(regions, geometry.as_ref())?;
        }
        let inner = Mutex::new(StereoMatcher::new(params).or_raise()?);
        Ok(Self { params, regions: regions.map(Bound::unbind), geometry, inner })
    }

    /// dict: every parameter, by the name it is given with; regions and geometry where they were given.
    #[getter]
    fn parameters<'py>(&self, py: Python<'py>) -> PyResult<Bound<'py, PyDict>> {
        let dict = parameters_dict(py, &self.params)?;
        if let Some(regions) = &self.regions {
            dict.set_item("regions", regions)?;
        }
        if let Some(geometry) = &self.geometry {
            dict.set_item("geometry", Bound::new(py, geometry.clone())?)?;
        }
        Ok(dict)
    }

    /// Disparities of the left image.
    ///
    /// Parameters
    /// ----------
    /// left, right : (H, W) or (H, W, 3) uint8
    ///     Rectified images; three channels are blue, green, red.
    /// left_valid, right_valid : (H, W) bool, optional
    ///     Pixels that have a source; the others get no answer and are no one's match.
    /// regions, geometry : optional
    ///     Instead of the matcher's own.
    /// out : DisparityMap, optional
    ///     Overwritten and returned, instead of a new one.
    ///
    /// Returns
    /// -------
    /// DisparityMap
    ///
    /// Raises
    /// ------
    /// ValueError
    ///     Sizes differ, a type is wrong, the images are narrower than the range of disparities, or a region is empty or
    ///     not inside them.
    #[pyo3(signature = (
        left, right, *, left_valid = None, right_valid = None, regions = None, geometry = None, out = None
    ))]
    #[expect(clippy::too_many_arguments, reason = "they are keywords")]
    fn __call__<'py>(
        &self,
        py: Python<'py>,
        left: &Bound<'py, PyAny>,
        right: &Bound<'py, PyAny>,
        left_valid: Option<&Bound<'py, PyAny>>,
        right_valid: Option<&Bound<'py, PyAny>>,
        regions: Option<&Bound<'py, PyAny>>,
        geometry: Option<PyRectifiedGeometry>,
        out: Option<Bound<'py, PyDisparityMap>>,
    ) -> PyResult<Bound<'py, PyDisparityMap>> {
        let (left, right) = (grey_image("left", left)?, grey_image("right", right)?);
        let left_valid = left_valid.map(|mask| mask_image("left_valid", mask)).transpose()?;
        let right_valid = right_valid.map(|mask| mask_image("right_valid", mask)).transpose()?;
        let geometry = geometry.as_ref().or(self.geometry.as_ref());
        let own = self.regions.as_ref().map(|regions| regions.bind(py));
        let regions = regions.or(own).map(|regions| match_regions(regions, geometry)).transpose()?;
        let out = match out {
            Some(out) => out,
            None => Bound::new(py, PyDisparityMap { inner: DisparityMap::default() })?,
        };
        {
            let (left, right) = (left.view(), right.view());
            let mut map = out.try_borrow_mut()?;
            let map = &mut map.inner;
            py.detach(|| {
                // A panic in an earlier call leaves buffers that the next one sets up again.
                let mut matcher = self.inner.lock().unwrap_or_else(PoisonError::into_inner);
                let (left_valid, right_valid) = (left_valid.as_ref(), right_valid.as_ref());
                let [left_valid, right_valid] = [left_valid, right_valid].map(|mask| mask.map(Image::view));
                match regions {
                    Some(regions) => {
                        matcher.compute_regions(left, right, left_valid, right_valid, &regions, map)
                    }
                    None => matcher.compute_masked(left, right, left_valid, right_valid, map),
                }
            })
            .or_raise()?;
        }
        Ok(out)
    }
}

/// The name of the instruction set in use: "avx512", "avx2", "neon" or "scalar". EPILINE_SIMD lowers it.
#[pyfunction]
fn simd_level() -> &'static str {
    epiline::kernels::simd_level()
}

/// Adds the classes to the module.
pub fn register(module: &Bound<'_, PyModule>) -> PyResult<()> {
    module.add_class::<PyDisparityMap>()?;
    module.add_class::<PyStereoMatcher>()?;
    module.add_function(wrap_pyfunction!(simd_level, module)?)
}
