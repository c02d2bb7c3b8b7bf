//! Recorded pairs in folders: left and right folders, and the layouts of KITTI.

pub use crate::source::LAYOUTS;

use crate::calibration_file::{self, Calibration};
use crate::limits::{MAX_IMAGES, MAX_PICTURE_BYTES, MAX_SIDE_PX, PICTURE};
use crate::motion_file::{TIMESTAMPS, read_timestamps};
use crate::{Geometry, PairSource, SourceError};
use image::error::{DecodingError, ImageFormatHint};
use image::{DynamicImage, ImageError, ImageReader, Limits};
use perception::excerpt::{REASON_CHARS, excerpt};
use perception::rig::Rig;
use std::fs::File;
use std::io::{BufRead, BufReader, Seek};
use std::path::{Path, PathBuf};

const ENDINGS: [&str; 6] = ["png", "pgm", "ppm", "pnm", "jpg", "jpeg"];

/// Period of a folder without `timestamps.csv`: KITTI's 10 Hz.
const DEFAULT_PERIOD_NS: u64 = 100_000_000;

/// Pairs of two image folders, in the order of their names.
#[derive(Debug)]
pub struct FolderSource {
    pairs: Vec<(PathBuf, PathBuf)>,
    size: (usize, usize),
    rig: Option<Rig>,
    rig_file: Option<PathBuf>,
    geometry: Geometry,
    /// Times of the pairs, in seconds, where the folder has them.
    times_s: Option<Vec<f64>>,
}

/// Decodes an image to grey. Returns its pixels, width and height.
///
/// # Errors
/// When the file cannot be read or decoded.
pub fn read_grey(path: &Path) -> Result<(Vec<u8>, usize, usize), SourceError> {
    let io = |source| SourceError::Io { path: path.to_owned(), source };
    let image = decode(open(path).map_err(io)?).map_err(|e| undecoded(path, &e))?;
    Ok(grey_of(image))
}

/// Opens an image file within the limit of its size: some decoders read the whole file into memory.
pub(crate) fn open(path: &Path) -> std::io::Result<ImageReader<BufReader<File>>> {
    let file = File::open(path)?;
    let about = file.metadata()?;
    if !about.is_file() {
        return Err(std::io::Error::other("not a regular file; give an image file"));
    }
    PICTURE.check(about.len())?;
    ImageReader::new(BufReader::new(file)).with_guessed_format()
}

/// Decodes with limits above any camera's image size: a damaged header must not exhaust the memory.
pub(crate) fn decode<R: BufRead + Seek>(mut reader: ImageReader<R>) -> Result<DynamicImage, ImageError> {
    let mut limits = Limits::default();
    (limits.max_image_width, limits.max_image_height) = (Some(MAX_SIDE_PX), Some(MAX_SIDE_PX));
    limits.max_alloc = Some(MAX_PICTURE_BYTES);
    reader.limits(limits);
    let image = reader.decode()?;
    some_pixels(image.width(), image.height())?;
    Ok(image)
}

/// A PNM may have a side of 0.
fn some_pixels(width: u32, height: u32) -> Result<(), ImageError> {
    if width > 0 && height > 0 {
        return Ok(());
    }
    let reason = format!("an image of {width}x{height} pixels");
    Err(ImageError::Decoding(DecodingError::new(ImageFormatHint::Unknown, reason)))
}

/// Grey pixels, width and height of an image.
pub(crate) fn grey_of(image: DynamicImage) -> (Vec<u8>, usize, usize) {
    let (width, height) = (image.width() as usize, image.height() as usize);
    let pixels = match image {
        DynamicImage::ImageLuma8(grey) => grey.into_raw(),
        other if !other.color().has_color() => other.into_luma8().into_raw(),
        colour => colour.into_rgb8().as_raw().chunks_exact(3).map(luma).collect(),
    };
    (pixels, width, height)
}

/// BT.601 luma in integer arithmetic: the result of OpenCV, and identical on every machine.
pub(crate) fn luma(rgb: &[u8]) -> u8 {
    let weighted: u32 = rgb.iter().zip([4899, 9617, 1868]).map(|(&v, weight)| u32::from(v) * weight).sum();
    ((weighted + (1 << 13)) >> 14) as u8
}

fn undecoded(path: &Path, error: &ImageError) -> SourceError {
    // A decoder may repeat what it found in a header.
    let reason = excerpt(&error.to_string(), REASON_CHARS).into_owned();
    SourceError::Decode { path: path.to_owned(), reason }
}

fn size_of(path: &Path) -> Result<(usize, usize), SourceError> {
    let io = |source| SourceError::Io { path: path.to_owned(), source };
    let size = open(path).map_err(io)?.into_dimensions();
    let size = size.and_then(|(width, height)| some_pixels(width, height).map(|()| (width, height)));
    let (width, height) = size.map_err(|e| undecoded(path, &e))?;
    Ok((width as usize, height as usize))
}

/// Image files of a folder, sorted by name.
///
/// # Errors
/// When the folder cannot be read, or has more than [`MAX_IMAGES`].
pub fn images(folder: &Path) -> Result<Vec<PathBuf>, SourceError> {
    let io = |source| SourceError::Io { path: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase);
        if ending.is_some_and(|e| ENDINGS.contains(&e.as_str())) {
            if found.len() == MAX_IMAGES {
                return Err(SourceError::TooMany {
                    path: folder.to_owned(),
                    what: "images",
                    limit: MAX_IMAGES,
                    remedy: "divide the recording into folders",
                });
            }
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

impl FolderSource {
    /// Opens a folder in one of the [`LAYOUTS`]. Reads the header of every image, so that a missing partner or
    /// a different size is reported before the first frame.
    ///
    /// The rig comes from `rig.toml`, `calib.txt` or `calib/<first name>.txt` in the folder, where one
    /// exists, and the times of the pairs from `timestamps.csv` (`name`, `left_s`).
    ///
    /// # Errors
    /// Names the faulty folder or file.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        if let Err(source) = std::fs::read_dir(path) {
            return Err(SourceError::Io { path: path.to_owned(), source });
        }
        let Some((left, right)) =
            LAYOUTS.iter().map(|(l, r)| (path.join(l), path.join(r))).find(|(l, r)| l.is_dir() && r.is_dir())
        else {
            return Err(SourceError::Layout { path: path.to_owned() });
        };
        let lefts = images(&left)?;
        let Some(first) = lefts.first().cloned() else {
            return Err(SourceError::Empty { path: left });
        };
        let partner = |image: &Path, folder: &Path| folder.join(image.file_name().unwrap_or_default());
        for image in images(&right)? {
            let path = partner(&image, &left);
            if !path.is_file() {
                return Err(SourceError::Unpaired { path, other: image });
            }
        }
        let expected = size_of(&first)?;
        let mut pairs = Vec::with_capacity(lefts.len());
        for image in lefts {
            let other = partner(&image, &right);
            if !other.is_file() {
                return Err(SourceError::Unpaired { path: other, other: image });
            }
            for path in [&image, &other] {
                let size = size_of(path)?;
                if size != expected {
                    return Err(SourceError::Size { path: path.clone(), size, first, expected });
                }
            }
            pairs.push((image, other));
        }
        let stem = first.file_stem().map(|stem| {
            let mut name = stem.to_owned();
            name.push(".txt");
            Path::new("calib").join(name)
        });
        let candidates = [Some("rig.toml".into()), Some("calib.txt".into()), stem];
        let colour = left.ends_with("image_2") || left.ends_with("image_02/data") || left.ends_with("left");
        let rig_file =
            candidates.into_iter().flatten().map(|name| path.join(name)).find(|file| file.is_file());
        let calibration = rig_file.as_deref().map(|file| calibration_file::open(file, colour)).transpose()?;
        let geometry = match &calibration {
            // The rig of a rectified pair says that there is one.
            Some(Calibration::Rectified(_)) => Geometry::Rectified,
            Some(Calibration::Cameras(_)) | None => Geometry::Unknown,
        };
        let rig = calibration.map(|calibration| calibration.rig());
        let mut source = Self { pairs, size: expected, rig, rig_file, geometry, times_s: None };
        source.times_s = source.read_times(&path.join(TIMESTAMPS))?;
        Ok(source)
    }

    /// The times of the pairs from `timestamps.csv`, if it exists.
    fn read_times(&self, path: &Path) -> Result<Option<Vec<f64>>, SourceError> {
        if !path.is_file() {
            return Ok(None);
        }
        let names = (0..self.pairs.len() as u64).map(|index| self.name(index).unwrap_or(""));
        let times_s = read_timestamps(path)?.of(names);
        times_s.map(Some).map_err(|reason| SourceError::Motion { path: path.to_owned(), reason })
    }

    /// Time of the first pair in `timestamps.csv`, in seconds; 0 without that file. The source time begins there.
    pub fn first_time_s(&self) -> f64 {
        self.times_s.as_ref().and_then(|times| times.first().copied()).unwrap_or(0.0)
    }

    /// Name of pair `index` without extension, for outputs.
    pub fn name(&self, index: u64) -> Option<&str> {
        self.pairs.get(usize::try_from(index).ok()?)?.0.file_stem()?.to_str()
    }
}

impl PairSource for FolderSource {
    fn size(&self) -> (usize, usize) {
        self.size
    }

    fn rig(&self) -> Option<Rig> {
        self.rig
    }

    fn geometry(&self) -> Geometry {
        self.geometry
    }

    fn rig_file(&self) -> Option<&Path> {
        self.rig_file.as_deref()
    }

    fn count(&self) -> Option<u64> {
        Some(self.pairs.len() as u64)
    }

    /// The median step of the times.
    fn period_ns(&self) -> u64 {
        let steps = self.times_s.iter().flat_map(|times| times.windows(2).map(|w| w[1] - w[0]));
        let mut steps: Vec<f64> = steps.filter(|step| *step > 0.0).collect();
        steps.sort_by(f64::total_cmp);
        steps.get(steps.len() / 2).map_or(DEFAULT_PERIOD_NS, |step_s| (step_s * 1e9).round() as u64).max(1)
    }

    fn time_ns(&self, index: u64) -> u64 {
        let times = self.times_s.as_deref().unwrap_or_default();
        let time_s = usize::try_from(index).ok().and_then(|i| times.get(i));
        match time_s {
            Some(time_s) => ((time_s - self.first_time_s()) * 1e9).round() as u64,
            None => index.saturating_mul(self.period_ns()),
        }
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        let count = self.pairs.len() as u64;
        let pair = usize::try_from(index).ok().and_then(|i| self.pairs.get(i));
        let (left_path, right_path) = pair.ok_or(SourceError::End { index, count })?;
        for (path, target) in [(left_path, left), (right_path, right)] {
            let (pixels, width, height) = read_grey(path)?;
            if (width, height) != self.size || pixels.len() != target.len() {
                return Err(SourceError::Size {
                    path: path.clone(),
                    size: (width, height),
                    first: self.pairs[0].0.clone(),
                    expected: self.size,
                });
            }
            target.copy_from_slice(&pixels);
        }
        Ok(())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::GrayImage;

    struct Recording {
        folder: tempfile::TempDir,
    }

    impl Recording {
        fn new(left: &str, right: &str, names: &[&str]) -> Self {
            let folder = tempfile::tempdir().unwrap();
            for side in [left, right] {
                std::fs::create_dir_all(folder.path().join(side)).unwrap();
                for (i, name) in names.iter().enumerate() {
                    let image = GrayImage::from_fn(12, 9, |x, y| {
                        [(x * 9 + y) as u8 + i as u8 + 10 * u8::from(side == right)].into()
                    });
                    image.save(folder.path().join(side).join(name)).unwrap();
                }
            }
            Self { folder }
        }

        fn path(&self, name: &str) -> PathBuf {
            self.folder.path().join(name)
        }

        fn error(&self) -> String {
            FolderSource::open(self.folder.path()).unwrap_err().to_string()
        }
    }

    #[test]
    fn all_layouts_are_read_in_the_order_of_names() {
        for (left, right) in LAYOUTS {
            let recording = Recording::new(left, right, &["a.png", "b.pgm"]);
            let mut source = FolderSource::open(recording.folder.path()).unwrap();
            assert_eq!((source.size(), source.count(), source.rig()), ((12, 9), Some(2), None));
            assert_eq!(source.name(1), Some("b"));
            let (mut l, mut r) = (vec![0; 108], vec![0; 108]);
            source.read(1, &mut l, &mut r).unwrap();
            assert_eq!((l[13], r[13]), (9 + 1 + 1, 9 + 1 + 11), "{left}");
            assert!(matches!(source.read(2, &mut l, &mut r), Err(SourceError::End { index: 2, count: 2 })));
        }
    }

    #[test]
    fn colour_becomes_grey_by_the_usual_weights() {
        assert_eq!(luma(&[255, 255, 255]), 255);
        assert_eq!((luma(&[255, 0, 0]), luma(&[0, 255, 0]), luma(&[0, 0, 255])), (76, 150, 29));
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("c.png");
        image::RgbImage::from_pixel(3, 2, [10, 200, 30].into()).save(&path).unwrap();
        assert_eq!(read_grey(&path).unwrap(), (vec![124; 6], 3, 2));
    }

    #[test]
    fn the_calibration_beside_the_images_is_used() {
        let recording = Recording::new("left", "right", &["7.png"]);
        std::fs::create_dir(recording.path("calib")).unwrap();
        let text = "P2: 700 0 600 0 0 700 180 0 0 0 1 0\nP3: 700 0 600 -378 0 700 180 0 0 0 1 0\n";
        std::fs::write(recording.path("calib/7.txt"), text).unwrap();
        let rig = FolderSource::open(recording.folder.path()).unwrap().rig().unwrap();
        assert_eq!(rig.baseline_m, 0.54);
        std::fs::write(recording.path("rig.toml"), "focal_px = 1").unwrap();
        assert!(recording.error().contains("rig.toml"));
    }

    #[test]
    fn times_beside_the_images_are_used() {
        let recording = Recording::new("left", "right", &["7.png", "8.png", "9.png"]);
        let open = || FolderSource::open(recording.folder.path());
        let plain = open().unwrap();
        assert_eq!(
            (plain.time_ns(2), plain.period_ns(), plain.first_time_s()),
            (200_000_000, 100_000_000, 0.0)
        );
        let text = "name,left_s,right_s\n7.png,12.5,12.5\n8.png,12.75,12.75\n9.png,13.25,13.25\n";
        std::fs::write(recording.path("timestamps.csv"), text).unwrap();
        let timed = open().unwrap();
        assert_eq!([0, 1, 2].map(|i| timed.time_ns(i) / 1_000_000), [0, 250, 750]);
        assert_eq!((timed.period_ns(), timed.first_time_s()), (500_000_000, 12.5));
        std::fs::write(recording.path("timestamps.csv"), text.replace("8.png", "6.png")).unwrap();
        let error = recording.error();
        assert!(error.contains("timestamps.csv: no line for image 8"), "{error}");
    }

    #[test]
    fn faults_are_named_before_the_first_frame() {
        let recording = Recording::new("left", "right", &["1.png", "2.png"]);
        std::fs::remove_file(recording.path("right/2.png")).unwrap();
        let error = recording.error();
        assert!(error.contains("right/2.png: missing"), "{error}");
        std::fs::rename(recording.path("left/2.png"), recording.path("right/2.png")).unwrap();
        assert!(recording.error().contains("left/2.png: missing"));

        GrayImage::new(13, 9).save(recording.path("left/2.png")).unwrap();
        let error = recording.error();
        assert!(error.contains("left/2.png: 13x9") && error.contains("12x9"), "{error}");

        std::fs::write(recording.path("left/2.png"), b"not an image").unwrap();
        assert!(recording.error().contains("left/2.png: cannot be decoded"));

        let empty = Recording::new("left", "right", &[]);
        assert!(empty.error().contains("is empty"), "{}", empty.error());
        let nothing = Recording::new("one", "two", &["1.png"]);
        assert!(nothing.error().contains("image_0 and image_1"), "{}", nothing.error());
        let error = FolderSource::open(Path::new("/nowhere/at/all")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all"), "{error}");
    }

    #[test]
    fn an_image_without_pixels_is_refused() {
        // Found by fuzzing.
        let recording = Recording::new("left", "right", &["1.pgm"]);
        for side in ["left/1.pgm", "right/1.pgm"] {
            std::fs::write(recording.path(side), "P5\n0 4\n255\n").unwrap();
        }
        for error in [recording.error(), read_grey(&recording.path("left/1.pgm")).unwrap_err().to_string()] {
            assert!(
                error.contains("left/1.pgm: cannot be decoded") && error.contains("0x4 pixels"),
                "{error}"
            );
        }
    }

    #[test]
    fn a_truncated_image_is_an_error_of_its_frame() {
        let recording = Recording::new("left", "right", &["1.png", "2.png"]);
        let path = recording.path("right/2.png");
        let bytes = std::fs::read(&path).unwrap();
        // The header is intact, the pixels are truncated.
        std::fs::write(&path, &bytes[..bytes.len() - 25]).unwrap();
        let mut source = FolderSource::open(recording.folder.path()).unwrap();
        let (mut l, mut r) = (vec![0; 108], vec![0; 108]);
        source.read(0, &mut l, &mut r).unwrap();
        let error = source.read(1, &mut l, &mut r).unwrap_err().to_string();
        assert!(error.contains("right/2.png: cannot be decoded"), "{error}");
    }
}
