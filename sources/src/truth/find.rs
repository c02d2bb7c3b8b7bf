//! Finds the pairs of a data set by its folder layout.

use super::error::TruthError;
use super::pair::{TruthFiles, TruthPair};
use crate::SourceError;
use crate::limits::{MAX_FOLDERS, MAX_IMAGES};
use std::collections::HashMap;
use std::fs;
use std::path::{Path, PathBuf};

/// File names of a scene folder.
struct SceneLayout {
    left: &'static str,
    right: &'static str,
    map: &'static str,
    right_map: Option<&'static str>,
    scale: Option<f64>,
}

impl SceneLayout {
    const fn new(
        [left, right, map]: [&'static str; 3],
        right_map: Option<&'static str>,
        scale: Option<f64>,
    ) -> Self {
        Self { left, right, map, right_map, scale }
    }
}

/// In order of preference.
const SCENES: [SceneLayout; 7] = [
    SceneLayout::new(["im0.png", "im1.png", "disp0GT.pfm"], None, Some(1.0)),
    SceneLayout::new(["im0.png", "im1.png", "disp0.pfm"], None, Some(1.0)),
    SceneLayout::new(["im2.ppm", "im6.ppm", "disp2.pgm"], Some("disp6.pgm"), Some(4.0)),
    SceneLayout::new(["im2.png", "im6.png", "disp2.png"], Some("disp6.png"), Some(4.0)),
    SceneLayout::new(["view1.png", "view5.png", "disp1.png"], Some("disp5.png"), None),
    SceneLayout::new(["left.png", "right.png", "groundtruth.png"], None, Some(16.0)),
    SceneLayout::new(["left.png", "right.png", "gt.png"], None, Some(256.0)),
];

/// Finds all pairs with ground truth in a folder and its subfolders, in order of their paths. A pair is named
/// after the folders that lead to it, and after its file where a folder contains several.
///
/// # Errors
/// When a folder cannot be listed, there is no pair, or two pairs have the same name.
pub fn find(root: &Path) -> Result<Vec<TruthPair>, TruthError> {
    let mut below = Vec::new();
    folders(root, &mut below)?;
    below.sort();
    let mut found = Vec::new();
    for folder in std::iter::once(root).chain(below.iter().map(PathBuf::as_path)) {
        let parts = folder.strip_prefix(root).unwrap_or(folder).components();
        let name = parts.map(|c| c.as_os_str().to_string_lossy()).collect::<Vec<_>>().join("_");
        disparity_maps(folder, &name, &mut found)?;
        depth_maps(folder, &name, &mut found)?;
        found.extend(scene(folder, name));
    }
    let mut names: HashMap<&str, &TruthPair> = HashMap::new();
    for pair in &found {
        if let Some(other) = names.insert(&pair.name, pair) {
            return Err(TruthError::SameName {
                name: pair.name.clone(),
                path: pair.left.clone(),
                other: other.left.clone(),
            });
        }
    }
    if found.is_empty() {
        return Err(TruthError::NoPairs { path: root.to_owned() });
    }
    Ok(found)
}

/// All subfolders. Symbolic links to folders are included but not followed, as a link may lead to a parent.
fn folders(root: &Path, found: &mut Vec<PathBuf>) -> Result<(), TruthError> {
    let mut open = vec![root.to_owned()];
    while let Some(folder) = open.pop() {
        let io = |source| TruthError::Io { path: folder.clone(), source };
        for entry in fs::read_dir(&folder).map_err(io)? {
            let entry = entry.map_err(io)?;
            let path = entry.path();
            if path.is_dir() {
                if found.len() >= MAX_FOLDERS {
                    return Err(too_many(root, "folders", MAX_FOLDERS));
                }
                found.push(path.clone());
                if entry.file_type().is_ok_and(|kind| kind.is_dir()) {
                    open.push(path);
                }
            }
        }
    }
    Ok(())
}

fn too_many(path: &Path, what: &'static str, limit: usize) -> TruthError {
    let remedy = "give the folder of one data set";
    SourceError::TooMany { path: path.to_owned(), what, limit, remedy }.into()
}

fn there(folder: &Path, name: &str) -> Option<PathBuf> {
    Some(folder.join(name)).filter(|path| path.exists())
}

/// PNG files of a folder, sorted by name.
pub(super) fn pictures(folder: &Path) -> Result<Vec<PathBuf>, TruthError> {
    let io = |source| TruthError::Io { path: folder.to_owned(), source };
    let mut found = Vec::new();
    for entry in fs::read_dir(folder).map_err(io)? {
        let path = entry.map_err(io)?.path();
        if path.extension().is_some_and(|e| e == "png") {
            if found.len() >= MAX_IMAGES {
                return Err(too_many(folder, "images", MAX_IMAGES));
            }
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// Pairs of a folder, one for each map in `maps`.
fn each_map(
    maps: &Path,
    name: &str,
    (left, right): (&Path, &Path),
    files: impl Fn(&Path) -> TruthFiles,
) -> Result<Vec<TruthPair>, TruthError> {
    let pair = |path: PathBuf| {
        let file = path.file_name().unwrap_or_default();
        let stem = path.file_stem().unwrap_or_default().to_string_lossy();
        TruthPair {
            name: if name.is_empty() { stem.into_owned() } else { format!("{name}_{stem}") },
            left: left.join(file),
            right: right.join(file),
            files: files(Path::new(file)),
        }
    };
    Ok(pictures(maps)?.into_iter().map(pair).collect())
}

/// KITTI 2012 and 2015.
fn disparity_maps(folder: &Path, name: &str, found: &mut Vec<TruthPair>) -> Result<(), TruthError> {
    let map = |kind: &str| {
        there(folder, &format!("disp_{kind}_0")).or_else(|| there(folder, &format!("disp_{kind}")))
    };
    let (all, noc) = (map("occ"), map("noc"));
    let images =
        if there(folder, "image_2").is_some() { ["image_2", "image_3"] } else { ["image_0", "image_1"] };
    let [left, right] = images.map(|name| there(folder, name));
    let (Some(left), Some(right), Some(maps)) = (left, right, all.as_ref().or(noc.as_ref())) else {
        return Ok(());
    };
    found.extend(each_map(maps, name, (&left, &right), |file| TruthFiles::Kitti {
        all: all.as_ref().map(|folder| folder.join(file)),
        noc: noc.as_ref().map(|folder| folder.join(file)).filter(|path| path.exists()),
    })?);
    Ok(())
}

/// KITTI's depth completion set.
fn depth_maps(folder: &Path, name: &str, found: &mut Vec<TruthPair>) -> Result<(), TruthError> {
    let [left, right, depth, calibration] =
        ["left", "right", "gt_depth_map", "calib"].map(|name| folder.join(name));
    if ![&left, &right, &depth, &calibration].iter().all(|path| path.is_dir()) {
        return Ok(());
    }
    found.extend(each_map(&depth, name, (&left, &right), |file| TruthFiles::Depth {
        depth: depth.join(file),
        calibration: calibration.join(file.with_extension("txt")),
    })?);
    Ok(())
}

fn scene(folder: &Path, name: String) -> Option<TruthPair> {
    let layout =
        SCENES.iter().find(|s| [s.left, s.right, s.map].iter().all(|file| there(folder, file).is_some()))?;
    // A scene folder given directly: use the name of the folder.
    let own = || folder.canonicalize().ok()?.file_name().map(|n| n.to_string_lossy().into_owned());
    Some(TruthPair {
        name: if name.is_empty() { own().unwrap_or_else(|| "scene".into()) } else { name },
        left: folder.join(layout.left),
        right: folder.join(layout.right),
        files: TruthFiles::Scene {
            map: folder.join(layout.map),
            mask: there(folder, "mask0nocc.png"),
            right_map: layout.right_map.and_then(|file| there(folder, file)),
            scale: layout.scale,
        },
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A tree of empty files.
    fn tree(files: &[&str]) -> tempfile::TempDir {
        let root = tempfile::tempdir().unwrap();
        for file in files {
            let path = root.path().join(file);
            fs::create_dir_all(path.parent().unwrap()).unwrap();
            fs::write(path, "").unwrap();
        }
        root
    }

    fn names(root: &tempfile::TempDir) -> Vec<String> {
        find(root.path()).unwrap().into_iter().map(|p| p.name).collect()
    }

    #[test]
    fn kitti_pairs_come_from_the_maps() {
        let root = tree(&[
            "b/image_2/1.png",
            "b/image_3/1.png",
            "b/disp_noc_0/2.png",
            "b/disp_noc_0/1.png",
            "b/disp_noc_0/notes.txt",
            "a/image_0/1.png",
            "a/image_1/1.png",
            "a/disp_occ/1.png",
            "a/disp_occ/3.png",
            "a/disp_noc/1.png",
            "c/image_2/1.png",
            "c/disp_noc_0/1.png",
        ]);
        assert_eq!(names(&root), ["a_1", "a_3", "b_1", "b_2"]);
        let pairs = find(root.path()).unwrap();
        let at = |file: &str| root.path().join(file);
        assert_eq!(pairs[1].left, at("a/image_0/3.png"));
        let only_all = TruthFiles::Kitti { all: Some(at("a/disp_occ/3.png")), noc: None };
        assert_eq!(pairs[1].files, only_all);
        assert_eq!(pairs[3].files, TruthFiles::Kitti { all: None, noc: Some(at("b/disp_noc_0/2.png")) });
        // The given folder is not part of the name.
        let inner = find(&at("b")).unwrap();
        assert_eq!(inner[0].name, "1");
    }

    #[test]
    fn scenes_and_depth_are_found_below() {
        let root = tree(&[
            "m/cones/im2.ppm",
            "m/cones/im6.ppm",
            "m/cones/disp2.pgm",
            "m/cones/disp6.pgm",
            "m/bike/im0.png",
            "m/bike/im1.png",
            "m/bike/disp0GT.pfm",
            "m/bike/disp0.pfm",
            "m/bike/mask0nocc.png",
            "m/cloth/view1.png",
            "m/cloth/view5.png",
            "m/cloth/disp1.png",
            "m/none/left.png",
            "m/none/right.png",
            "k/left/7.png",
            "k/right/7.png",
            "k/gt_depth_map/7.png",
            "k/calib/7.txt",
        ]);
        assert_eq!(names(&root), ["k_7", "m_bike", "m_cloth", "m_cones"]);
        let pairs = find(root.path()).unwrap();
        assert_eq!(pairs[0].truth_file(), root.path().join("k/gt_depth_map/7.png"));
        match &pairs[1].files {
            TruthFiles::Scene { map, mask: Some(_), right_map: None, scale: Some(1.0) } => {
                assert!(map.ends_with("disp0GT.pfm"));
            }
            other => panic!("{other:?}"),
        }
        assert!(matches!(&pairs[2].files, TruthFiles::Scene { right_map: None, scale: None, .. }));
        assert!(matches!(&pairs[3].files, TruthFiles::Scene { right_map: Some(_), .. }));
        // A scene folder given directly.
        assert_eq!(find(&root.path().join("m/cones")).unwrap()[0].name, "cones");
        // A link to a parent does not recurse.
        #[cfg(unix)]
        {
            std::os::unix::fs::symlink(root.path(), root.path().join("k/back")).unwrap();
            assert_eq!(names(&root).len(), 4);
        }
    }

    #[test]
    fn faults_name_the_folder_and_the_layouts() {
        let root = tree(&["x/left/1.png", "x/right/1.png"]);
        let error = find(root.path()).unwrap_err().to_string();
        for part in ["no stereo pair", "image_2", "gt_depth_map", "disp0GT.pfm", "groundtruth.png"] {
            assert!(error.contains(part), "{error}");
        }
        let error = find(Path::new("/nowhere/at/all")).unwrap_err().to_string();
        assert!(error.contains("/nowhere/at/all"), "{error}");
        let scene = |folder: &str| ["im2.png", "im6.png", "disp2.png"].map(|f| format!("{folder}/{f}"));
        let files: Vec<String> = scene("a/b").into_iter().chain(scene("a_b")).collect();
        let root = tree(&files.iter().map(String::as_str).collect::<Vec<_>>());
        let error = find(root.path()).unwrap_err().to_string();
        assert!(error.contains("called a_b"), "{error}");
    }
}
