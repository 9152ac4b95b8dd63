//! Rig files: our own, and what other systems write.
//!
//! Errors name the file, the entry and the value; a file that is read is a rig that could exist.

mod aligned;
mod boofcv;
mod document;
mod kalibr;
mod kitti;
mod middlebury;
mod mrcal;
mod opencv;
mod rig;
mod ros;
mod xml;
mod yaml;

use std::fs::File;
use std::io::{Read, Write};
use std::path::{Path, PathBuf};

use self::document::{Entry, Node};
use super::{CameraModel, Pose, StereoCalibration};
use crate::error::{Error, Result};

/// No calibration of real cameras comes near this; it keeps a wrong path from filling the memory.
const MAX_FILE_BYTES: u64 = 64 << 20;

/// A kind of rig file.
#[derive(Debug, Clone, Copy, PartialEq, Eq)]
pub enum Format {
    /// Ours: one YAML file with everything, covariance and views too.
    Epiline,
    /// OpenCV's `FileStorage` as YAML, XML or JSON: one file, or intrinsics and extrinsics. Written as YAML, or XML to
    /// a name that ends so.
    OpenCv,
    /// ROS `camera_info`: a file for each camera.
    Ros,
    /// Kalibr's `camchain.yaml`.
    Kalibr,
    /// mrcal's `.cameramodel`: a file for each camera.
    Mrcal,
    /// BoofCV's `stereo.yaml`, read only.
    BoofCv,
    /// Middlebury's `calib.txt` of an aligned pair.
    Middlebury,
    /// KITTI's calibration of its aligned colour cameras, 2 and 3, or of Karlsruhe's only pair. Written as [`KittiGrey`](Self::KittiGrey).
    Kitti,
    /// The same of the grey cameras, 0 and 1.
    KittiGrey,
    /// KITTI's calibration of its colour cameras before their pictures were aligned, read only.
    KittiRaw,
}

impl Format {
    /// Every format, in the order of [`NAMES`](Self::NAMES).
    pub const ALL: [Self; 10] = [
        Self::Epiline,
        Self::OpenCv,
        Self::Ros,
        Self::Kalibr,
        Self::Mrcal,
        Self::BoofCv,
        Self::Middlebury,
        Self::Kitti,
        Self::KittiGrey,
        Self::KittiRaw,
    ];

    /// What the formats are called.
    pub const NAMES: [&'static str; 10] = [
        "epiline",
        "opencv",
        "ros",
        "kalibr",
        "mrcal",
        "boofcv",
        "middlebury",
        "kitti",
        "kitti-grey",
        "kitti-raw",
    ];

    /// The format of a file, by its content; `None` if it is none of these.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if the file cannot be read; [`Error::InvalidFile`] if it is not text, or no document.
    pub fn of_file(path: impl AsRef<Path>) -> Result<Option<Self>> {
        Ok(Source::open(path.as_ref(), None)?.format)
    }

    /// Whether files of this format describe pictures that are aligned already.
    pub fn is_aligned(self) -> bool {
        matches!(self, Self::Middlebury | Self::Kitti | Self::KittiGrey)
    }

    /// Whether it is KITTI's, whose files hold several cameras.
    fn is_kitti(self) -> bool {
        matches!(self, Self::Kitti | Self::KittiGrey | Self::KittiRaw)
    }

    /// The format of a name.
    ///
    /// # Errors
    ///
    /// [`Error::InvalidParameter`] if there is none.
    pub fn of_name(name: &str) -> Result<Self> {
        let found = Self::NAMES.iter().position(|known| *known == name);
        found.map(|i| Self::ALL[i]).ok_or_else(|| {
            Error::invalid(
                "format",
                format!("'{name}'"),
                format!("expected one of {}", Self::NAMES.join(", ")),
            )
        })
    }

    /// The format's name.
    pub fn name(self) -> &'static str {
        let place = Self::ALL.iter().position(|format| *format == self);
        Self::NAMES[place.expect("every format is in the list")]
    }

    /// How many files a rig of this format has: fewest and most.
    fn file_count(self) -> [usize; 2] {
        match self {
            Self::OpenCv => [1, 2],
            Self::Ros | Self::Mrcal => [2, 2],
            _ => [1, 1],
        }
    }

    /// Fails unless a rig of this format has so many files.
    fn require_files(self, paths: &[PathBuf]) -> Result<()> {
        let [fewest, most] = self.file_count();
        if (fewest..=most).contains(&paths.len()) {
            return Ok(());
        }
        let what = match most {
            1 => "one file",
            _ => "two files, of the left and of the right camera",
        };
        let value = format!("{} files", paths.len());
        Err(Error::invalid("path", value, format!("format '{}' has {what}", self.name())))
    }

    /// The format that a rig is written in by default: what the names end with.
    fn to_write(paths: &[PathBuf]) -> Result<Self> {
        let ends = |extension: &str| {
            paths.iter().all(|p| p.extension().is_some_and(|e| e.eq_ignore_ascii_case(extension)))
        };
        Ok(match paths.len() {
            1 if ends("xml") => Self::OpenCv,
            1 if ends("txt") => Self::Middlebury,
            1 => Self::Epiline,
            2 if ends("cameramodel") => Self::Mrcal,
            2 if ends("xml") => Self::OpenCv,
            2 if ends("yaml") || ends("yml") => Self::Ros,
            count => {
                let expected =
                    "expected one file, or two that end in .yaml (ROS), .cameramodel or .xml, or a format";
                return Err(Error::invalid("path", format!("{count} files"), expected));
            }
        })
    }
}

/// What a file may leave open.
#[derive(Debug, Clone, Copy, PartialEq)]
pub struct ReadOptions {
    /// The format; by default the content decides.
    pub format: Option<Format>,
    /// Width and height of the images, pixels, for files without them (OpenCV's, KITTI's benchmarks).
    pub image_size: Option<(usize, usize)>,
    /// Metres in one unit of length, for files that do not say (OpenCV's, BoofCV's): 0.001 for a board measured in
    /// millimetres.
    pub unit_m: f64,
    /// Numbers of the left and of the right camera in KITTI's files, which hold four; by default those of the format.
    pub cameras: Option<[usize; 2]>,
}

impl Default for ReadOptions {
    fn default() -> Self {
        Self { format: None, image_size: None, unit_m: 1.0, cameras: None }
    }
}

/// What every format says of a rig.
struct Pair {
    left: CameraModel,
    right: CameraModel,
    right_from_left: Pose,
}

impl StereoCalibration {
    /// Reads a rig from one file of any [`Format`]; the content decides which.
    ///
    /// # Errors
    ///
    /// Those of [`load_files`](Self::load_files).
    pub fn load(path: impl AsRef<Path>) -> Result<Self> {
        Self::load_files(&[path.as_ref().to_owned()], &ReadOptions::default())
    }

    /// Reads a rig from one file, or from two: of the left and the right camera, or OpenCV's intrinsics and
    /// extrinsics.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] if a file cannot be read; [`Error::InvalidFile`] with the file, the entry and its value if
    /// one is missing, of the wrong type, NaN or beyond reason, no format is recognised, or the rig could not exist;
    /// [`Error::InvalidParameter`] for options that do not apply.
    pub fn load_files(paths: &[PathBuf], options: &ReadOptions) -> Result<Self> {
        if !(options.unit_m.is_finite() && options.unit_m > 0.0) {
            return Err(Error::invalid("unit_m", options.unit_m, "must be positive and finite"));
        }
        let [first, ..] = paths else {
            return Err(Error::invalid("path", "0 files", "expected one file or two"));
        };
        if let Some(format) = options.format {
            format.require_files(paths)?;
        }
        let sources =
            paths.iter().map(|path| Source::open(path, options.format)).collect::<Result<Vec<_>>>()?;
        let format = match options.format {
            Some(format) => format,
            None => {
                let format = sources[0].format.ok_or_else(|| {
                    let content = sources[0].document.as_ref().unwrap_or(&Node::Null);
                    let known = Format::NAMES.join(", ");
                    file_error(
                        first,
                        "document",
                        format!("is {content}: no rig file of a known format ({known})"),
                    )
                })?;
                format.require_files(paths)?;
                format
            }
        };
        if let (Some(cameras), false) = (options.cameras, format.is_kitti()) {
            let expected = format!("is for KITTI's files, which hold several; this is '{}'", format.name());
            return Err(Error::invalid("cameras", format!("{cameras:?}"), expected));
        }
        let rig = read(format, &sources, options)?;
        // What single entries cannot show: a rotation that is none, cameras in one place.
        rig.validate().map_err(|error| match error {
            Error::InvalidParameter { name, value, expected } => {
                file_error(first, name, format!("is {value}: {expected}"))
            }
            other => other,
        })?;
        Ok(rig)
    }

    /// Writes the rig to one file: as YAML of ours with everything, exactly; as OpenCV's XML to a name that ends in
    /// `.xml`, as Middlebury's to `.txt`.
    ///
    /// # Errors
    ///
    /// Those of [`save_files`](Self::save_files).
    pub fn save(&self, path: impl AsRef<Path>) -> Result<()> {
        self.save_files(&[path.as_ref().to_owned()], None)
    }

    /// Writes the rig to one file or two, in a format or the one that the names suggest: two `.yaml` files are ROS's,
    /// two `.cameramodel` files mrcal's. Each appears complete or not at all.
    ///
    /// # Errors
    ///
    /// [`Error::Io`] with the path, if a file cannot be written; [`Error::InvalidFile`] with what the format cannot
    /// hold of this rig; [`Error::InvalidParameter`] for a number of files that the format does not have. Covariance,
    /// errors and views are ours alone, and other formats go without.
    pub fn save_files(&self, paths: &[PathBuf], format: Option<Format>) -> Result<()> {
        let format = match format {
            Some(format) => format,
            None => Format::to_write(paths)?,
        };
        format.require_files(paths)?;
        self.validate()?;
        let first = &paths[0];
        let texts = match format {
            Format::Epiline => vec![rig::text_of(first, self)?],
            Format::OpenCv => opencv::texts_of(paths, self)?,
            Format::Ros => ros::texts_of(paths, self)?,
            Format::Kalibr => vec![kalibr::text_of(first, self)?],
            Format::Mrcal => mrcal::texts_of(paths, self)?,
            Format::Middlebury => vec![middlebury::text_of(first, self)?],
            Format::Kitti | Format::KittiGrey => vec![kitti::text_of(first, self)?],
            Format::BoofCv | Format::KittiRaw => {
                let value = format!("'{}'", format.name());
                return Err(Error::invalid("format", value, "can be read but not written"));
            }
        };
        paths.iter().zip(texts).try_for_each(|(path, text)| write_atomically(path, &text))
    }
}

/// Whether a parsed document is of a format.
type Recognises = fn(&Entry<'_>) -> bool;

/// A file's text and, where it is one, its tree.
struct Source<'a> {
    path: &'a Path,
    text: String,
    document: Option<Node>,
    format: Option<Format>,
}

impl<'a> Source<'a> {
    /// Reads a file and, without a format, recognises it by its content.
    fn open(path: &'a Path, format: Option<Format>) -> Result<Self> {
        let text = read_text(path)?;
        let by_lines = match format {
            Some(format) => (format == Format::Middlebury || format.is_kitti()).then_some(format),
            None if middlebury::recognises(&text) => Some(Format::Middlebury),
            None => kitti::recognised(&text),
        };
        if by_lines.is_some() {
            return Ok(Self { path, text, document: None, format: by_lines });
        }
        let document = if text.contains("'optimization_inputs'") {
            mrcal::parse(path, &text)?
        } else {
            opencv::parse(path, &text)?
        };
        let root = Entry::root(path, &document);
        let known: [(Format, Recognises); 6] = [
            (Format::Epiline, rig::recognises),
            (Format::Mrcal, mrcal::recognises),
            (Format::Kalibr, kalibr::recognises),
            (Format::Ros, ros::recognises),
            (Format::BoofCv, boofcv::recognises),
            (Format::OpenCv, opencv::recognises),
        ];
        let found = known.iter().find(|(_, recognises)| recognises(&root)).map(|(format, _)| *format);
        Ok(Self { path, text, document: Some(document), format: format.or(found) })
    }

    fn root(&self) -> Entry<'_> {
        Entry::root(self.path, self.document.as_ref().unwrap_or(&Node::Null))
    }
}

fn read(format: Format, sources: &[Source<'_>], options: &ReadOptions) -> Result<StereoCalibration> {
    let first = &sources[0];
    let pair = match format {
        Format::Epiline => return rig::read(&first.root(), &first.text),
        Format::OpenCv => {
            let files: Vec<Entry<'_>> = sources.iter().map(Source::root).collect();
            opencv::read(&files, options)
        }
        Format::Ros => ros::read(&first.root(), &sources[1].root()),
        Format::Kalibr => kalibr::read(&first.root()),
        Format::Mrcal => mrcal::read(&first.root(), &sources[1].root()),
        Format::BoofCv => boofcv::read(&first.root(), options),
        Format::Middlebury => middlebury::read(first.path, &first.text),
        Format::Kitti | Format::KittiGrey | Format::KittiRaw => {
            kitti::read_pair(first.path, &first.text, format, options)
        }
    }?;
    Ok(StereoCalibration {
        left: pair.left,
        right: pair.right,
        right_from_left: pair.right_from_left,
        rms_px: f64::NAN,
        epipolar_error_px: f64::NAN,
        covariance: None,
        views: Vec::new(),
        outliers: Vec::new(),
        board_warp: None,
    })
}

/// The images' size of a file that does not hold it.
fn size_from_options(path: &Path, options: &ReadOptions) -> Result<[usize; 2]> {
    let (width, height) = options
        .image_size
        .ok_or_else(|| file_error(path, "image_size", "is not in the file; say how large the images are"))?;
    Ok([width, height])
}

/// Exactly `N` words that are finite numbers.
fn finite_numbers<'a, const N: usize>(
    path: &Path,
    name: &str,
    words: impl Iterator<Item = &'a str>,
) -> Result<[f64; N]> {
    let words: Vec<&str> = words.collect();
    if words.len() != N {
        return Err(file_error(path, name, format!("has {} numbers; expected {N}", words.len())));
    }
    let mut values = [0.0; N];
    for (value, word) in values.iter_mut().zip(words) {
        *value =
            word.parse().ok().filter(|v: &f64| v.is_finite()).ok_or_else(|| {
                file_error(path, name, format!("holds '{word}', which is not a finite number"))
            })?;
    }
    Ok(values)
}

fn io_error(path: &Path, reason: impl std::fmt::Display) -> Error {
    Error::Io { path: path.display().to_string(), reason: reason.to_string() }
}

fn file_error(path: &Path, field: impl Into<String>, reason: impl Into<String>) -> Error {
    Error::InvalidFile { what: path.display().to_string(), field: field.into(), reason: reason.into() }
}

/// A whole text file, UTF-8 and of reasonable size.
fn read_text(path: &Path) -> Result<String> {
    let file = File::open(path).map_err(|e| io_error(path, e))?;
    let mut bytes = Vec::new();
    file.take(MAX_FILE_BYTES + 1).read_to_end(&mut bytes).map_err(|e| io_error(path, e))?;
    if bytes.len() as u64 > MAX_FILE_BYTES {
        return Err(file_error(
            path,
            "file",
            format!("is larger than {} MiB; no rig is", MAX_FILE_BYTES >> 20),
        ));
    }
    String::from_utf8(bytes).map_err(|e| {
        let offset = e.utf8_error().valid_up_to();
        file_error(path, "file", format!("is not text: the byte at offset {offset} is not UTF-8"))
    })
}

/// Writes a file so that its name never stands for half of it: a temporary name, then a rename.
fn write_atomically(path: &Path, text: &str) -> Result<()> {
    let name = path.file_name().ok_or_else(|| io_error(path, "is not a file name"))?.to_string_lossy();
    let temporary = path.with_file_name(format!(".{name}.{}.tmp", std::process::id()));
    let write = || {
        let mut file = File::create(&temporary)?;
        file.write_all(text.as_bytes())?;
        file.sync_all()?;
        std::fs::rename(&temporary, path)
    };
    write().map_err(|e| {
        // The reason is in `e`; whether the leftover can be removed changes nothing about it.
        let _ = std::fs::remove_file(&temporary);
        io_error(path, e)
    })
}
