//! The built-in drive.

use super::file::SceneFile;
use super::{Scene, SceneFrame, library};
use crate::{Geometry, PairSource, SourceError};
use perception::rig::Rig;
use std::sync::LazyLock;

/// The scene `drive`; a test checks that it parses.
static FILE: LazyLock<SceneFile> = LazyLock::new(|| match library::load("drive") {
    Ok(file) => file,
    Err(error) => panic!("the built-in drive is invalid: {error}"),
});

/// The built-in drive (scene `drive`): a street with houses, parked cars, posts and a small box, and a lead
/// car that the vehicle approaches and that then pulls away. It repeats every [`Drive::CYCLE_S`] seconds
/// without end. Equal seeds give equal images.
#[derive(Debug)]
pub struct Drive {
    scene: Scene,
}

impl Drive {
    /// Period of the drive, in seconds.
    pub const CYCLE_S: f64 = 12.0;

    /// Height of the camera above the road, in metres.
    pub const CAMERA_HEIGHT_M: f64 = 1.25;

    /// The drive with the paper's rig: 640 × 480 px, baseline 120 mm, focal length 879 px.
    pub fn paper(seed: u64) -> Self {
        let (rig, size, _) = super::file::NamedRig::Paper.values();
        Self::new(seed, rig, size, 12.5)
    }

    /// The drive with another rig, at `fps` pairs per second.
    ///
    /// # Panics
    /// When the size is zero or `fps` is not above zero.
    pub fn new(seed: u64, rig: Rig, size: (usize, usize), fps: f64) -> Self {
        assert!(size.0 > 0 && size.1 > 0 && fps > 0.0);
        let file = SceneFile { seed, fps, ..FILE.clone() };
        Self { scene: Scene::seen_by(file, rig, size, Self::CAMERA_HEIGHT_M) }
    }

    /// The same drive at `fps` pairs per second.
    ///
    /// # Panics
    /// When `fps` is not above zero.
    pub fn at_rate(self, fps: f64) -> Self {
        Self { scene: self.scene.at_rate(fps) }
    }

    /// Distance of the lead car's rear, `t` seconds into the drive, in metres.
    pub fn lead_distance_m(t: f64) -> f64 {
        let lead = FILE.objects.iter().find_map(|object| object.ahead.as_ref());
        lead.map_or(f64::INFINITY, |path| path.at(t.rem_euclid(Self::CYCLE_S)).0)
    }

    /// Time of pair `index`, in seconds from the start.
    pub fn time_s(&self, index: u64) -> f64 {
        self.scene.time_s(index)
    }

    /// Pair `index` with its ground truth.
    pub fn frame(&mut self, index: u64) -> SceneFrame {
        self.scene.frame(index)
    }
}

impl PairSource for Drive {
    fn size(&self) -> (usize, usize) {
        self.scene.size()
    }

    fn rig(&self) -> Option<Rig> {
        self.scene.rig()
    }

    fn geometry(&self) -> Geometry {
        Geometry::Rectified
    }

    fn count(&self) -> Option<u64> {
        self.scene.count()
    }

    fn period_ns(&self) -> u64 {
        self.scene.period_ns()
    }

    fn read(&mut self, index: u64, left: &mut [u8], right: &mut [u8]) -> Result<(), SourceError> {
        self.scene.read(index, left, right)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_drive_is_the_same_every_time_and_moves() {
        let (mut a, mut b) = (Drive::paper(1), Drive::paper(1));
        let pixels = 640 * 480;
        let (mut left, mut right) = (vec![0; pixels], vec![0; pixels]);
        b.read(7, &mut left, &mut right).unwrap();
        b.read(20, &mut left, &mut right).unwrap();
        let frame = a.frame(20);
        assert!((frame.left, frame.right) == (left.clone(), right.clone()));
        a.read(21, &mut left, &mut right).unwrap();
        assert!(a.frame(20).left != left);
        assert!(Drive::paper(2).frame(20).left != a.frame(20).left);
        // It repeats without end.
        assert_eq!(a.count(), None);
        assert!((a.time_s(157) - 0.56).abs() < 1e-9);
    }

    #[test]
    fn truth_and_picture_belong_together() {
        let mut drive = Drive::paper(3);
        let rig = drive.rig().unwrap();
        for index in [0, 40, 85] {
            let frame = drive.frame(index);
            let truth = &frame.truth;
            let lead = Drive::lead_distance_m(drive.time_s(index));
            let object = truth.objects.iter().find(|o| o.lateral_m.abs() < 1e-9).expect("the car ahead");
            assert!((object.distance_m - lead).abs() < 0.02, "{} {lead}", object.distance_m);
            assert!(object.in_path && object.on_road && object.subject);
            // The lowest row shows the road.
            let road = rig.baseline_m / Drive::CAMERA_HEIGHT_M * (479.0 - rig.cy_px);
            assert!((f64::from(truth.disparity_px[479 * 640 + 320]) - road).abs() < 1e-3);
            assert!(truth.objects.windows(2).all(|w| w[0].distance_m <= w[1].distance_m));
        }
    }

    #[test]
    fn the_lead_car_comes_and_goes() {
        assert_eq!(Drive::lead_distance_m(0.5), 28.0);
        assert_eq!(Drive::lead_distance_m(7.0), 6.0);
        assert_eq!(Drive::lead_distance_m(12.0), Drive::lead_distance_m(0.0));
        assert!(Drive::lead_distance_m(4.0) < 20.0);
    }
}
