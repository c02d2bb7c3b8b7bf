//! What each reader of files takes at most. A size is checked before the file is read, a count before the memory or the
//! time that it costs is spent. Each limit lies far above real files, and far below what a board cannot bear.
//!
//! The counts of cascades are in [`perception::recognition::xml`].

use crate::bounded_file::FileLimit;

/// Scene files. The largest of this project has 2 KiB.
pub const SCENE: FileLimit =
    FileLimit { what: "a scene", bytes: 1 << 20, remedy: "give a TOML file as docs/scenes.md describes it" };

/// Objects of a scene, with those of the rows beside its road. Each is a mesh of up to 75 KiB in memory (a tree), and
/// each frame goes through all of them. The largest scene of this project has 179.
pub const MAX_SCENE_OBJECTS: usize = 5000;

/// Waypoints of one value of a scene: one each second of the longest scene. Each evaluation goes through all of them.
pub const MAX_WAYPOINTS: usize = 3600;

/// Lane markings of a road, solid or dashed. Each is drawn in every frame.
pub const MAX_LANE_MARKINGS: usize = 32;

/// Strips of ground beside a road. Each is drawn in every frame.
pub const MAX_STRIPS: usize = 32;

/// Calibrations: rig files and those of OpenCV, ROS, Kalibr and KITTI. Each has less than 10 KiB.
pub const CALIBRATION: FileLimit = FileLimit {
    what: "a calibration",
    bytes: 256 << 10,
    remedy: "give a rig file, or a calibration of OpenCV, ROS, Kalibr or KITTI",
};

/// Nesting of lists and maps in a YAML calibration.
pub const MAX_YAML_DEPTH: usize = 16;

/// Images and maps: PNG, JPEG, PNM, PFM. As many bytes as a decoded one may take.
pub const PICTURE: FileLimit = FileLimit {
    what: "an image",
    bytes: MAX_PICTURE_BYTES,
    remedy: "give one camera's image, or a map of its size",
};

/// Bytes of a decoded image: 128 million grey pixels, more than any camera has.
pub const MAX_PICTURE_BYTES: u64 = 128 << 20;

/// Width and height of an image, in pixels.
pub const MAX_SIDE_PX: u32 = 1 << 14;

/// OpenCV cascades.
pub const CASCADE: FileLimit = FileLimit {
    what: "a cascade",
    bytes: perception::recognition::xml::MAX_BYTES,
    remedy: "give an OpenCV cascade XML",
};

/// HOG models.
pub const HOG_MODEL: FileLimit = FileLimit {
    what: "a HOG model",
    bytes: perception::recognition::hog::model::MAX_BYTES,
    remedy: "give a model in the format of models/people.hog",
};

/// Neural networks.
pub const NETWORK: FileLimit = FileLimit {
    what: "a network",
    bytes: perception::recognition::network::limits::MAX_BYTES,
    remedy: "give a small ONNX file, as models/objects.onnx",
};

/// What the scores of a detector say.
pub const SCORE_CALIBRATION: FileLimit = FileLimit {
    what: "a calibration of scores",
    bytes: perception::recognition::calibration::MAX_BYTES,
    remedy: "write it with lookout evaluate classes --calibrate",
};

/// Checkpoints of a training run: some cascades in text, with their statistics.
pub const CHECKPOINT: FileLimit =
    FileLimit { what: "a checkpoint", bytes: 256 << 20, remedy: "remove it to train from the start" };

/// Results of a run, a line of JSON for each frame: half a million lines of 1 KiB.
pub const RESULTS: FileLimit = FileLimit {
    what: "a file of results",
    bytes: 512 << 20,
    remedy: "divide the recording, or give an obstacles.jsonl",
};

/// KITTI's labels of one image. A line has about 100 bytes.
pub const LABELS: FileLimit = FileLimit {
    what: "a label file",
    bytes: 1 << 20,
    remedy: "give the labels of one image in KITTI's format",
};

/// Labelled objects of one image.
pub const MAX_LABELS: usize = 2000;

/// Images of a folder: a camera's at 30 Hz for nine hours. The names are held in memory, and the head of each is read.
pub const MAX_IMAGES: usize = 1_000_000;

/// Folders below that of a data set.
pub const MAX_FOLDERS: usize = 100_000;

/// Uncompressed bytes of a chunk of a recording; also those of a message outside of chunks.
pub const MAX_CHUNK_BYTES: u64 = 128 << 20;

/// Messages of a chunk. One takes about 100 bytes in memory beside its data.
pub const MAX_CHUNK_MESSAGES: usize = 1_000_000;

/// Bytes of a schema, a channel or a metadata record.
pub const MAX_DESCRIPTION_BYTES: u64 = 4 << 20;

/// Topics of a recording, and its schemas and metadata records.
pub const MAX_TOPICS: usize = 4096;

/// Bytes of all names, schemas' names and metadata that are kept of a recording.
pub const MAX_KEPT_BYTES: usize = 16 << 20;

/// Messages of a recording: 1000 a second for eight hours. The index takes 16 bytes for each.
pub const MAX_MESSAGES: usize = 30_000_000;

/// Chunks of a recording, with messages outside of chunks: 100 a second for eight hours. The index takes about 100 bytes
/// for each.
pub const MAX_CHUNKS: usize = 3_000_000;

/// Length of a drive on a road with bends, in metres: its course is tabulated in steps of 0.5 m, and each frame goes
/// through all of its strips. The longest of this project has 400 m.
pub const MAX_BENDING_ROAD_M: f64 = 20_000.0;

/// Roads that branch off the road of a scene. They lie half a millimetre below one another, and together above the
/// pavements.
pub const MAX_BRANCHES: usize = 16;

/// Files of a vehicle's motion: CSV, KITTI's poses, OXTS. [`MAX_MOTION_LINES`] of 90 bytes.
pub const MOTION: FileLimit = FileLimit {
    what: "a motion file",
    bytes: 256 << 20,
    remedy: "give motion.csv, KITTI's poses.txt or an OXTS table, of one drive",
};

/// Samples of a motion file: 100 a second for eight hours. Each takes 24 to 96 bytes in memory.
pub const MAX_MOTION_LINES: usize = 3_000_000;

/// Columns of a motion file. OXTS has 30.
pub const MAX_MOTION_COLUMNS: usize = 256;

/// DBC files. Those of whole vehicles have up to 5 MiB.
pub const DBC: FileLimit = FileLimit {
    what: "a DBC file",
    bytes: 32 << 20,
    remedy: "give the DBC file of the bus with your signals",
};
