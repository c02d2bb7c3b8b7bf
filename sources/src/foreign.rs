//! Files that are no source of pairs but are often taken for one: what they are, and the command that converts them.

use crate::picture;
use std::fs::File;
use std::io::Read;
use std::path::Path;

/// Endings of video files, in lower case.
const VIDEOS: [&str; 13] =
    ["mp4", "mkv", "avi", "mov", "webm", "ogv", "m4v", "mpg", "mpeg", "ts", "h264", "h265", "mjpeg"];

/// The first bytes of a file that tell its format.
const MAGIC_BYTES: usize = 16;

/// The remedy for videos without a decoder. Its parts in braces are the path.
#[cfg(not(feature = "gstreamer"))]
const VIDEO: &str = "a video, which lookout replay decodes with ffmpeg, and that is not on the PATH: install it (apt install \
                     ffmpeg). Or write pictures, from one video with both images side by side: ffmpeg -i {} -vf crop=iw/2:ih:0:0 left/%06d.png -vf crop=iw/2:ih:iw/2:0 right/%06d.png, \
                     from two: ffmpeg -i LEFT -i RIGHT -map 0 left/%06d.png -map 1 right/%06d.png, into folders left and right \
                     that exist; then lookout replay the folder that holds both, with --fps";

/// Whether a path is that of a video, which [`crate::video`] reads.
pub fn is_video(path: &Path) -> bool {
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).unwrap_or_default();
    VIDEOS.contains(&&ending[..])
}

/// What to do with a video where nothing decodes it.
#[cfg(not(feature = "gstreamer"))]
pub fn video_without_ffmpeg(path: &Path) -> String {
    VIDEO.replace("{}", &path.display().to_string())
}

/// What a file is, with what to do, if it is known not to be a source of pairs.
pub fn explain(path: &Path) -> Option<String> {
    let name = path.display().to_string();
    let ending = path.extension().and_then(|e| e.to_str()).map(str::to_ascii_lowercase).unwrap_or_default();
    let mut magic = Vec::with_capacity(MAGIC_BYTES);
    // Opening a pipe would wait for its writer.
    if path.is_file()
        && let Ok(file) = File::open(path)
    {
        // A file that cannot be read is told by its ending.
        let _ = file.take(MAGIC_BYTES as u64).read_to_end(&mut magic);
    }
    let text = if magic.starts_with(b"#ROSBAG") || ending == "bag" {
        "a ROS 1 bag: convert it with `mcap convert {} drive.mcap` (the mcap tool), and give drive.mcap"
    } else if magic.starts_with(b"SQLite format 3") || ending == "db3" {
        "a ROS 2 bag in SQLite: convert it with `mcap convert {} drive.mcap` (the mcap tool), or record with \
         `ros2 bag record -s mcap`, and give the .mcap file"
    } else if VIDEOS.contains(&&ending[..]) {
        "a video: give lookout replay the video itself, {}, if it has both images side by side, or one video of each camera \
         with --left and --right"
    } else if picture::ENDINGS.contains(&&ending[..]) {
        "a single picture: give the folder with the left and the right pictures, or, for one pair, use \
         `lookout obstacles LEFT RIGHT` or `lookout disparity LEFT RIGHT`"
    } else if ending == "toml" {
        "a TOML file: a scene is given as scene:{}, a configuration with -c"
    } else if ["zip", "tar", "gz", "tgz", "bz2", "xz", "7z"].contains(&&ending[..]) {
        "an archive: unpack it, and give the folder with the pictures"
    } else {
        return None;
    };
    Some(text.replace("{}", &name))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn each_kind_is_named_with_its_remedy() {
        let folder = tempfile::tempdir().unwrap();
        for (name, content, parts) in [
            ("drive.bag", "", ["ROS 1 bag", "mcap convert"]),
            ("renamed", "#ROSBAG V2.0\n", ["ROS 1 bag", "renamed drive.mcap"]),
            ("drive.db3", "SQLite format 3\0", ["ROS 2 bag in SQLite", "mcap convert"]),
            ("drive.MP4", "", ["a video", "--left and --right"]),
            ("left.tiff", "", ["a single picture", "lookout disparity"]),
            ("road.toml", "", ["a TOML file", "scene:"]),
            ("drive.tar.gz", "", ["an archive", "unpack"]),
        ] {
            let path = folder.path().join(name);
            std::fs::write(&path, content).unwrap();
            let text = explain(&path).unwrap();
            assert!(parts.iter().all(|part| text.contains(part)), "{name}: {text}");
        }
        assert_eq!(explain(&folder.path().join("notes.txt")), None);
    }
}
