//! Between NumPy and the core: arrays to views, results to arrays, errors to exceptions.

use epiline::Error;
use epiline::image::{Image, ImageRef};
use epiline::preprocess::grey_from_bgr;
use numpy::{
    Element, PyArray1, PyArray2, PyArrayMethods, PyReadonlyArray2, PyReadonlyArray3, PyUntypedArray,
    PyUntypedArrayMethods,
};
use pyo3::exceptions::{PyOSError, PyValueError};
use pyo3::prelude::*;

/// The exception classes.
pub mod exception {
    pyo3::create_exception!(
        epiline,
        Error,
        pyo3::exceptions::PyException,
        "The data do not determine an answer, or a file's content is not what its format demands."
    );
}

/// The Python exception for an error of the core.
pub fn py_error(error: Error) -> PyErr {
    let message = error.to_string();
    match error {
        Error::Degenerate { .. } | Error::InvalidFile { .. } => exception::Error::new_err(message),
        Error::Io { .. } => PyOSError::new_err(message),
        _ => PyValueError::new_err(message),
    }
}

/// `Result::map_err(py_error)` that reads as a verb.
pub trait OrRaise<T> {
    /// Turns a core error into a Python exception.
    fn or_raise(self) -> PyResult<T>;
}

impl<T> OrRaise<T> for epiline::Result<T> {
    fn or_raise(self) -> PyResult<T> {
        self.map_err(py_error)
    }
}

fn describe(object: &Bound<'_, PyAny>) -> String {
    match object.cast::<PyUntypedArray>() {
        Ok(array) => format!("{} array of shape {:?}", array.dtype(), array.shape()),
        Err(_) => object.get_type().name().map_or_else(|_| "an object".into(), |name| name.to_string()),
    }
}

fn contiguous_or_copy<'py, T: Element + Copy + Default>(
    name: &'static str,
    array: PyReadonlyArray2<'py, T>,
) -> PyResult<Pixels<'py, T>> {
    let (height, width) = (array.shape()[0], array.shape()[1]);
    if array.is_c_contiguous() {
        // Checked here so that `view` cannot fail later.
        ImageRef::new(name, array.as_slice()?, width, height).or_raise()?;
        return Ok(Pixels::Borrowed(array));
    }
    let data = array.as_array().iter().copied().collect();
    Ok(Pixels::Owned(Image::from_vec(name, data, width, height).or_raise()?))
}

/// A single-channel image from Python: borrowed where its rows are contiguous, else copied.
pub enum Pixels<'py, T: Element + Copy> {
    /// The caller's memory.
    Borrowed(PyReadonlyArray2<'py, T>),
    /// A copy.
    Owned(Image<T>),
}

impl<T: Element + Copy + Default> Pixels<'_, T> {
    /// The image.
    pub fn view(&self) -> ImageRef<'_, T> {
        match self {
            Self::Borrowed(array) => {
                let (height, width) = (array.shape()[0], array.shape()[1]);
                ImageRef::new("image", array.as_slice().expect("checked to be contiguous"), width, height)
                    .expect("checked when borrowed")
            }
            Self::Owned(image) => image.view(),
        }
    }
}

/// A grey image from a `(H, W)` or `(H, W, 3)` uint8 array; colour (BGR) is converted.
pub fn grey_image<'py>(name: &'static str, object: &Bound<'py, PyAny>) -> PyResult<Pixels<'py, u8>> {
    if let Ok(array) = object.extract::<PyReadonlyArray2<'py, u8>>() {
        return contiguous_or_copy(name, array);
    }
    if let Ok(array) = object.extract::<PyReadonlyArray3<'py, u8>>()
        && array.shape()[2] == 3
    {
        let (height, width) = (array.shape()[0], array.shape()[1]);
        let copied;
        let bytes = if array.is_c_contiguous() {
            array.as_slice()?
        } else {
            copied = array.as_array().iter().copied().collect::<Vec<u8>>();
            &copied
        };
        let (bgr, _) = bytes.as_chunks::<3>();
        let mut grey = Image::default();
        grey_from_bgr(ImageRef::new(name, bgr, width, height).or_raise()?, &mut grey);
        return Ok(Pixels::Owned(grey));
    }
    let given = describe(object);
    Err(PyValueError::new_err(format!("{name}: expected a uint8 array (H, W) or (H, W, 3), got {given}")))
}

/// A validity mask from a `(H, W)` bool array: 255 where true.
pub fn mask_image(name: &'static str, object: &Bound<'_, PyAny>) -> PyResult<Image<u8>> {
    let array = object.extract::<PyReadonlyArray2<'_, bool>>().map_err(|_| {
        PyValueError::new_err(format!("{name}: expected a bool array (H, W), got {}", describe(object)))
    })?;
    let (height, width) = (array.shape()[0], array.shape()[1]);
    let data = array.as_array().iter().map(|&valid| if valid { 255 } else { 0 }).collect();
    Image::from_vec(name, data, width, height).or_raise()
}

/// A `(H, W)` array of exactly the element type `T`; no conversion, so that a wrong type is an error and not a guess.
pub fn typed_image<'py, T: Element + Copy + Default>(
    name: &'static str,
    object: &Bound<'py, PyAny>,
    dtype: &str,
) -> PyResult<Pixels<'py, T>> {
    let array = object.extract::<PyReadonlyArray2<'py, T>>().map_err(|_| {
        PyValueError::new_err(format!("{name}: expected a {dtype} array (H, W), got {}", describe(object)))
    })?;
    contiguous_or_copy(name, array)
}

/// Anything NumPy reads as `rows x N` float64 (lists included), row after row.
pub fn rows_of<const N: usize>(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec<[f64; N]>> {
    let numpy = object.py().import("numpy")?;
    let array = numpy.call_method1("ascontiguousarray", (object, "float64")).map_err(|error| {
        PyValueError::new_err(format!("{name}: expected numbers of shape (rows, {N}): {error}"))
    })?;
    let array = array.extract::<PyReadonlyArray2<'_, f64>>().map_err(|_| {
        PyValueError::new_err(format!("{name}: expected shape (rows, {N}), got {}", describe(&array)))
    })?;
    if array.shape()[1] != N {
        let shape = array.shape();
        return Err(PyValueError::new_err(format!("{name}: expected shape (rows, {N}), got {shape:?}")));
    }
    Ok(array.as_slice()?.as_chunks::<N>().0.to_vec())
}

/// Anything NumPy reads as one-dimensional float64.
pub fn vector_of(name: &str, object: &Bound<'_, PyAny>) -> PyResult<Vec<f64>> {
    let numpy = object.py().import("numpy")?;
    let array = numpy
        .call_method1("ascontiguousarray", (object, "float64"))
        .and_then(|array| numpy.call_method1("atleast_1d", (array,)))
        .map_err(|error| PyValueError::new_err(format!("{name}: expected numbers: {error}")))?;
    let array = array.extract::<numpy::PyReadonlyArray1<'_, f64>>().map_err(|_| {
        PyValueError::new_err(format!("{name}: expected one dimension, got {}", describe(&array)))
    })?;
    Ok(array.as_slice()?.to_vec())
}

/// A parameter that cannot be negative, as the core's type for it.
pub fn whole<T: TryFrom<i64>>(name: &'static str, value: i64) -> PyResult<T> {
    T::try_from(value).map_err(|_| {
        let expected = if value < 0 { "must not be negative" } else { "is far too large" };
        PyValueError::new_err(format!("{name} = {value}: {expected}"))
    })
}

/// A new `(H, W)` array with an image's content.
pub fn image_array<'py, T: Element + Copy + Default>(
    py: Python<'py>,
    image: &Image<T>,
) -> Bound<'py, PyArray2<T>> {
    mapped_array(py, image, |value| value)
}

/// An image handed over as an `(H, W)` array, without a copy.
pub fn given_array<T: Element + Copy + Default>(py: Python<'_>, image: Image<T>) -> Bound<'_, PyArray2<T>> {
    let sides = [image.height(), image.width()];
    PyArray1::from_vec(py, image.into_vec()).reshape(sides).expect("an image has height x width elements")
}

/// A new `(H, W)` array of `f(pixel)`.
pub fn mapped_array<'py, T: Copy + Default, U: Element + Copy>(
    py: Python<'py>,
    image: &Image<T>,
    f: impl FnMut(T) -> U,
) -> Bound<'py, PyArray2<U>> {
    PyArray1::from_iter(py, image.as_slice().iter().copied().map(f))
        .reshape([image.height(), image.width()])
        .expect("an image has height x width elements")
}
