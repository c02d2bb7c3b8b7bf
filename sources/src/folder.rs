//! Recorded pairs in folders: two folders of pictures, or one with pictures of both cameras, in many layouts.

pub use crate::pairs::images;
pub use crate::picture::read_grey;
pub use crate::source::LAYOUTS;

use crate::calibration_file::{self, Calibration};
use crate::motion_file::{TIMESTAMPS, read_timestamps};
use crate::pairs::{self, Pair, Pairs};
use crate::picture::{self, Decoded, Header, Interpretation};
use crate::{Geometry, PairSource, SourceError, check_two_files};
use perception::rig::Rig;
use std::io::ErrorKind;
use std::path::{Path, PathBuf};

/// Period of a folder without times: KITTI's 10 Hz.
const DEFAULT_PERIOD_NS: u64 = 100_000_000;

/// Pictures of each camera, evenly over the recording, in which the depth of 16-bit pictures is looked for.
const DEPTH_SAMPLES: usize = 4;

/// Digits of a name that is a time in nanoseconds since 1970, as EuRoC and TUM-VI have it: from 2001 on.
const TIME_DIGITS: usize = 19;

/// How a folder is read.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct FolderOptions {
    /// Patterns of the left and the right pictures, instead of one of the [`LAYOUTS`].
    pub patterns: Option<(PathBuf, PathBuf)>,
    /// How values become grey levels.
    pub interpretation: Interpretation,
    /// Refuses a folder with a picture that cannot be read, instead of leaving its pair to [`PairSource::read`].
    pub is_strict: bool,
}

/// Pairs of pictures, in the natural order of their names.
#[derive(Debug)]
pub struct FolderSource {
    pairs: Vec<Pair>,
    /// The first pair that can be read.
    first: usize,
    size: (usize, usize),
    rig: Option<Rig>,
    rig_file: Option<PathBuf>,
    geometry: Geometry,
    has_colour_cameras: bool,
    interpretation: Interpretation,
    notes: Vec<String>,
    /// Times of the pairs, in seconds, where the folder has them.
    times_s: Option<Vec<f64>>,
}

/// What the headers of all pictures say.
struct Headers {
    /// The first pair that can be read, and the header of its left picture.
    first: usize,
    header: Header,
    /// Number of pairs with a picture that cannot be read, and the first reason.
    unreadable: usize,
    reason: Option<SourceError>,
    has_colour: bool,
    is_deep: bool,
}

impl Headers {
    /// Reads all headers. Pictures of another size are an error, those that cannot be read only if `is_strict`.
    fn read(pairs: &[Pair], is_strict: bool) -> Result<Self, SourceError> {
        let mut found: Option<Self> = None;
        let (mut unreadable, mut reason) = (0, None);
        for (i, (left, right)) in pairs.iter().enumerate() {
            let both = picture_of(left, right, picture::header)
                .and_then(|l| Ok([l, picture_of(right, left, picture::header)?]));
            let headers = match both {
                Ok(headers) => headers,
                Err(error) if error.is_of_one_pair() && !is_strict => {
                    unreadable += 1;
                    reason.get_or_insert(error);
                    continue;
                }
                Err(error) => return Err(error),
            };
            let found = found.get_or_insert(Self {
                first: i,
                header: headers[0],
                unreadable: 0,
                reason: None,
                has_colour: false,
                is_deep: false,
            });
            for (path, header) in [left, right].into_iter().zip(headers) {
                if header.size != found.header.size {
                    return Err(SourceError::Size {
                        path: path.clone(),
                        size: header.size,
                        first: pairs[found.first].0.clone(),
                        expected: found.header.size,
                    });
                }
                found.has_colour |= header.has_colour;
                found.is_deep |= header.is_deep;
            }
        }
        match (found, reason) {
            (Some(found), reason) => Ok(Self { unreadable, reason, ..found }),
            (None, Some(reason)) => Err(reason),
            (None, None) => Err(SourceError::End { index: 0, count: 0 }),
        }
    }
}

/// Reads a picture; if it is not there, but its partner is, that is told.
fn picture_of<T>(
    path: &Path,
    partner: &Path,
    read: impl Fn(&Path) -> Result<T, SourceError>,
) -> Result<T, SourceError> {
    match read(path) {
        Err(SourceError::Io { source, .. }) if source.kind() == ErrorKind::NotFound && partner.is_file() => {
            Err(SourceError::Unpaired { path: path.to_owned(), other: partner.to_owned() })
        }
        result => result,
    }
}

impl FolderSource {
    /// Opens a folder with [`FolderOptions::default`].
    ///
    /// # Errors
    /// Names the faulty folder or file.
    pub fn open(path: &Path) -> Result<Self, SourceError> {
        Self::open_with(path, &FolderOptions::default())
    }

    /// Opens a folder in one of the [`LAYOUTS`], one with left and right in the names of its pictures, or the pictures of
    /// two patterns. Reads the header of every image, so that a different size is reported before the first frame.
    ///
    /// The rig comes from `rig.toml`, `calib.txt`, `calib/<first name>.txt`, KITTI's `calib_cam_to_cam.txt` or EuRoC's
    /// `sensor.yaml` beside the pictures, where one exists, and the times of the pairs from `timestamps.csv` (`name`,
    /// `left_s`), or from names that are times in nanoseconds.
    ///
    /// # Errors
    /// Names the faulty folder or file.
    pub fn open_with(path: &Path, options: &FolderOptions) -> Result<Self, SourceError> {
        let Pairs { pairs, calibration_folders, is_by_order } = match &options.patterns {
            Some((left, right)) => pairs::by_patterns(left, right)?,
            None => pairs::find(path)?,
        };
        if let Some((left, right)) = pairs.first() {
            check_two_files(left, right)?;
        }
        let headers = Headers::read(&pairs, options.is_strict)?;
        let mut source = Self {
            first: headers.first,
            size: headers.header.size,
            rig: None,
            rig_file: None,
            geometry: Geometry::Unknown,
            has_colour_cameras: true,
            interpretation: options.interpretation,
            notes: Vec::new(),
            times_s: None,
            pairs,
        };
        source.find_rig(&calibration_folders)?;
        let timestamps =
            calibration_folders.iter().map(|folder| folder.join(TIMESTAMPS)).find(|f| f.is_file());
        source.times_s = match timestamps {
            Some(file) => Some(source.read_times(&file)?),
            None => source.times_of_names(),
        };
        if headers.is_deep && source.interpretation.bits.is_none() {
            source.find_depth()?;
        }
        source.note(&headers, is_by_order);
        Ok(source)
    }

    /// The rig beside the pictures.
    fn find_rig(&mut self, folders: &[PathBuf]) -> Result<(), SourceError> {
        let left = &self.pairs[self.first].0;
        let mut name = left.file_stem().unwrap_or_default().to_owned();
        name.push(".txt");
        let names = [
            PathBuf::from("rig.toml"),
            "calib.txt".into(),
            Path::new("calib").join(name),
            calibration_file::KITTI_RAW.into(),
        ];
        let mut candidates: Vec<PathBuf> =
            folders.iter().flat_map(|folder| names.iter().map(move |name| folder.join(name))).collect();
        // KITTI's raw data have one calibration for the drives of a day, EuRoC one in the folder of each camera.
        candidates.extend(folders.iter().filter_map(|folder| {
            folder.canonicalize().ok()?.parent().map(|f| f.join(calibration_file::KITTI_RAW))
        }));
        candidates
            .extend(left.parent().and_then(Path::parent).map(|camera| camera.join(calibration_file::SENSOR)));
        self.rig_file = candidates.into_iter().find(|file| file.is_file());
        let folder = left.parent().unwrap_or(Path::new(""));
        // KITTI's grey cameras are 0 and 1.
        let is_grey = ["image_0", "image_00", "image_00/data"].iter().any(|name| folder.ends_with(name));
        self.has_colour_cameras = !is_grey;
        let is_colour =
            ["image_2", "image_02", "image_02/data", "left"].iter().any(|name| folder.ends_with(name));
        let Some(file) = &self.rig_file else { return Ok(()) };
        let calibration = calibration_file::open_for(file, is_colour, self.size)?;
        self.geometry = match &calibration {
            // The rig of a rectified pair says that there is one.
            Calibration::Rectified { .. } => Geometry::Rectified,
            Calibration::Cameras(_) => Geometry::Unknown,
        };
        self.rig = Some(calibration.rig());
        Ok(())
    }

    /// The depth of 16-bit pictures: the largest of some.
    fn find_depth(&mut self) -> Result<(), SourceError> {
        let mut bits = None;
        let step = self.pairs.len().div_ceil(DEPTH_SAMPLES).max(1);
        for (left, right) in self.pairs[self.first..].iter().step_by(step) {
            for path in [left, right] {
                match Decoded::read(path) {
                    Ok(decoded) => bits = bits.max(decoded.bits()),
                    Err(error) if error.is_of_one_pair() => {}
                    // It is reported when its turn comes.
                    Err(SourceError::Io { .. }) => {}
                    Err(error) => return Err(error),
                }
            }
        }
        self.interpretation.bits = bits;
        if let Some(bits) = bits {
            let left = &self.pairs[self.first].0;
            self.notes.push(picture::scaled_note(left, bits));
        }
        Ok(())
    }

    /// Collects what the user should know.
    fn note(&mut self, headers: &Headers, is_by_order: bool) {
        let (count, (left, right)) = (self.pairs.len(), &self.pairs[self.first]);
        if let Some(reason) = &headers.reason {
            self.notes.push(format!(
                "{} of {count} pairs cannot be read and are left out, the first: {reason}; --strict stops instead",
                headers.unreadable
            ));
        }
        if is_by_order {
            self.notes.push(format!(
                "the names of left and right pictures have nothing in common: they are paired in their order, the first are {} and {}",
                left.display(),
                right.display()
            ));
        }
        if headers.has_colour && self.interpretation.bayer.is_some() {
            self.notes.push(format!(
                "{}: pictures with colours, but source.bayer is set, which is for raw pixels of a sensor: set it to \"none\"",
                left.display()
            ));
        }
    }

    /// The times of the pairs from `timestamps.csv`.
    fn read_times(&self, path: &Path) -> Result<Vec<f64>, SourceError> {
        let names = (0..self.pairs.len() as u64).map(|index| self.name(index).unwrap_or(""));
        let times_s = read_timestamps(path)?.of(names);
        times_s.map_err(|reason| SourceError::Motion { path: path.to_owned(), reason })
    }

    /// The times of the pairs, if the names of the left pictures are times in nanoseconds.
    fn times_of_names(&self) -> Option<Vec<f64>> {
        let time = |index: usize| -> Option<u64> {
            let name = self.name(index as u64)?;
            (name.len() == TIME_DIGITS).then(|| name.parse().ok())?
        };
        let first = time(0)?;
        // Less the first, because a double does not hold nanoseconds since 1970.
        (0..self.pairs.len()).map(|index| Some(time(index)?.checked_sub(first)? as f64 * 1e-9)).collect()
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

    fn has_colour_cameras(&self) -> bool {
        self.has_colour_cameras
    }

    fn notes(&self) -> Vec<String> {
        self.notes.clone()
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
        for (path, other, target) in [(left_path, right_path, left), (right_path, left_path, right)] {
            let decoded = picture_of(path, other, Decoded::read)?;
            let size = (decoded.width, decoded.height);
            let pixels = decoded.grey(self.interpretation);
            if size != self.size || pixels.len() != target.len() {
                return Err(SourceError::Size {
                    path: path.clone(),
                    size,
                    first: self.pairs[self.first].0.clone(),
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
    use crate::bayer::Bayer;
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

    /// Reads a pair of 12×9 pixels; the left one.
    fn left(source: &mut FolderSource, index: u64) -> Result<Vec<u8>, String> {
        let (mut l, mut r) = (vec![0; 108], vec![0; 108]);
        source.read(index, &mut l, &mut r).map(|()| l).map_err(|e| e.to_string())
    }

    #[test]
    fn a_picture_that_is_missing_or_broken_costs_its_pair_only() {
        let recording = Recording::new("left", "right", &["1.png", "2.png", "3.png"]);
        std::fs::remove_file(recording.path("right/2.png")).unwrap();
        std::fs::write(recording.path("left/1.png"), b"not an image").unwrap();
        let mut source = FolderSource::open(recording.folder.path()).unwrap();
        let notes = source.notes().join("\n");
        assert!(notes.contains("2 of 3 pairs cannot be read") && notes.contains("left/1.png"), "{notes}");
        assert_eq!((source.count(), source.size()), (Some(3), (12, 9)));
        assert!(left(&mut source, 0).unwrap_err().contains("left/1.png: cannot be decoded"));
        assert!(left(&mut source, 1).unwrap_err().contains("right/2.png: missing, but "));
        assert_eq!(left(&mut source, 2).unwrap()[0], 2);
        let strict = FolderOptions { is_strict: true, ..FolderOptions::default() };
        let error = FolderSource::open_with(recording.folder.path(), &strict).unwrap_err();
        assert!(error.is_of_one_pair() && error.to_string().contains("left/1.png"), "{error}");
        // Where no pair can be read, that is an error.
        std::fs::remove_file(recording.path("left/3.png")).unwrap();
        assert!(recording.error().contains("left/1.png: cannot be decoded"));
    }

    #[test]
    fn pictures_of_any_format_and_depth_are_read_by_layouts_and_patterns() {
        let folder = tempfile::tempdir().unwrap();
        let path = |name: &str| folder.path().join(name);
        for side in ["l", "r"] {
            for i in 1..3_u16 {
                // Twelve bits; the first pair is darker than eight of them.
                let deep = image::ImageBuffer::<image::Luma<u16>, _>::from_fn(12, 9, |x, _| {
                    [(x as u16 + 1) * 340 * (i - 1) + 7].into()
                });
                deep.save(path(&format!("{side}{i}.tif"))).unwrap();
            }
        }
        let patterns = Some((path("l*.tif"), path("r*.tif")));
        let mut source = FolderSource::open_with(
            Path::new(""),
            &FolderOptions { patterns: patterns.clone(), ..FolderOptions::default() },
        )
        .unwrap();
        assert!(source.notes()[0].contains("scaled from 12 bits to 8; source.bits"), "{:?}", source.notes());
        assert_eq!(left(&mut source, 0).unwrap()[0], 0, "7 of 4095");
        assert_eq!(left(&mut source, 1).unwrap()[11], ((12 * 340 + 7) * 255 / 4095 + 1) as u8);
        let interpretation = Interpretation { bits: Some(16), bayer: Bayer::named("rggb") };
        let options = FolderOptions { patterns, interpretation, is_strict: false };
        let mut source = FolderSource::open_with(Path::new(""), &options).unwrap();
        assert!(source.notes().is_empty());
        assert!(left(&mut source, 1).unwrap().iter().all(|v| *v < 17), "taken as 16 bits it is dark");
    }

    #[test]
    fn names_that_are_times_give_the_times_of_euroc() {
        let names = ["1403636579763555584.png", "1403636579813555456.png", "1403636579913555456.png"];
        let recording = Recording::new("mav0/cam0/data", "mav0/cam1/data", &names);
        let source = FolderSource::open(recording.folder.path()).unwrap();
        assert_eq!([0, 1, 2].map(|i| source.time_ns(i) / 1_000_000), [0, 49, 149]);
        let inner = FolderSource::open(&recording.path("mav0")).unwrap();
        assert_eq!(inner.count(), Some(3));
    }

    #[test]
    fn faults_are_named_before_the_first_frame() {
        let recording = Recording::new("left", "right", &["1.png", "2.png"]);
        GrayImage::new(13, 9).save(recording.path("left/2.png")).unwrap();
        let error = recording.error();
        assert!(error.contains("left/2.png: 13x9") && error.contains("12x9"), "{error}");

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
