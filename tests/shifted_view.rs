//! One image of a real calibration set is shifted by half a pixel; the calibration names its view.

use crate::support::{Bench, save_grey, shared_data, turns};
use nalgebra::Vector2;
use perception::calibration::finder::{self, ordered_alike};
use perception::calibration::{Board, Crop, Grade, Lens, Pair, Places, StereoCalibration, calibrate, judge};
use perception::image::GreyView;
use std::path::{Path, PathBuf};

const SIZE: (usize, usize) = (640, 360);
const VIEWS: usize = 29;
/// Views of the 29 in which the board rested between the exposures, to about 0.2 px. Only the positions of the boards
/// show that, so the views were chosen by them: one of the three views with the largest offsets was removed at a time,
/// with enough tilted ones kept, until the verdict was good.
const RESTING: [usize; 13] = [1, 2, 4, 5, 6, 8, 13, 14, 21, 22, 24, 25, 27];
/// Largest distance between corners of similar views, root mean square.
const NEAR_PX: f64 = 35.0;
const WAYS: [(isize, isize); 4] = [(1, 0), (-1, 0), (0, 1), (0, -1)];
const SIDES: [&str; 2] = ["left", "right"];

fn board() -> Board {
    Board::new(9, 6, 0.02423).unwrap()
}

fn picture(folder: &Path, side: usize, view: usize) -> Vec<u8> {
    let (pixels, w, h) =
        sources::folder::read_grey(&folder.join(format!("{}{view}.jpg", SIDES[side]))).unwrap();
    assert_eq!((w, h), SIZE);
    pixels
}

/// An image shifted by half a pixel in a direction, by a cubic through four pixels.
fn shifted(pixels: &[u8], (across, down): (isize, isize)) -> Vec<u8> {
    let (width, height) = (SIZE.0 as isize, SIZE.1 as isize);
    let at = |x: isize, y: isize| {
        i32::from(pixels[(y.clamp(0, height - 1) * width + x.clamp(0, width - 1)) as usize])
    };
    let places = (0..height).flat_map(|y| (0..width).map(move |x| (x, y)));
    places
        .map(|(x, y)| {
            let back = |k: isize| at(x - k * across, y - k * down);
            let sixteenths = 9 * (back(0) + back(1)) - back(-1) - back(2);
            ((sixteenths + 8) / 16).clamp(0, 255) as u8
        })
        .collect()
}

fn corners(pixels: &[u8]) -> Places {
    let view = GreyView::new(pixels, SIZE.0, SIZE.1, SIZE.0).unwrap();
    finder::find(view, &board()).unwrap().corners
}

/// The corners of the views, and those of each image shifted in each direction: view, side, direction.
struct Set {
    views: Vec<usize>,
    pairs: Vec<Pair>,
    shifted: Vec<[[Places; 4]; 2]>,
}

impl Set {
    fn new(folder: &Path, views: &[usize]) -> Self {
        let mut set = Self { views: views.to_vec(), pairs: Vec::new(), shifted: Vec::new() };
        for &view in views {
            let pictures = [0, 1].map(|side| picture(folder, side, view));
            let [left, right] = [0, 1].map(|side| corners(&pictures[side]));
            let alike = |corners: &Places| ordered_alike(&left, corners, &board());
            set.shifted
                .push([0, 1].map(|side| WAYS.map(|way| alike(&corners(&shifted(&pictures[side], way))))));
            set.pairs.push(Pair { right: alike(&right), left });
        }
        set
    }

    fn calibrate(&self, pairs: &[Pair]) -> (StereoCalibration, Grade) {
        let names: Vec<String> = self.views.iter().map(usize::to_string).collect();
        let c = calibrate(&board(), SIZE, pairs, Lens::Radial2, Crop::Valid).unwrap();
        let verdict = judge(&c, &names);
        for (view, name) in c.views.iter().zip(&names) {
            let is_said = verdict.reasons.iter().any(|r| {
                let text = &r.text;
                text.starts_with(&format!("{name} was left out")) || text.contains(&format!(" {name} ("))
            });
            assert_eq!(is_said, view.moved, "{name}: {verdict:?}");
        }
        (c, verdict.grade)
    }

    /// How far the offsets of two views differ, root mean square in pixels across and down: of views whose
    /// corners are `NEAR_PX` apart or less, and of all.
    fn differences(&self) -> [Vector2<f64>; 2] {
        let (c, _) = self.calibrate(&self.pairs);
        let mut sums = [(Vector2::zeros(), 0.0); 2];
        for (i, a) in self.pairs.iter().enumerate() {
            for (j, b) in self.pairs.iter().enumerate().take(i) {
                let both = a.left.iter().flatten().zip(b.left.iter().flatten());
                let apart = both.map(|(p, q)| (p - q).norm_squared()).sum::<f64>();
                let squares = (c.views[i].shift_px - c.views[j].shift_px).map(|d| d * d);
                let is_near = (apart / a.left.len() as f64).sqrt() <= NEAR_PX;
                for (sum, count) in &mut sums[if is_near { 0 } else { 1 }..] {
                    *sum += squares;
                    *count += 1.0;
                }
            }
        }
        println!("{} pairs of views are alike", sums[0].1);
        sums.map(|(sum, count)| (sum / count).map(f64::sqrt))
    }

    /// Shifts every image in every direction, one at a time; asserts that no such verdict is good. Returns whether its
    /// view is named, and whether it was before the shift.
    fn tries(&self) -> Vec<(bool, bool)> {
        let (before, _) = self.calibrate(&self.pairs);
        let mut tries = Vec::new();
        for view in 0..self.pairs.len() {
            for side in 0..2 {
                for corners in &self.shifted[view][side] {
                    let mut pairs = self.pairs.clone();
                    let own = &mut pairs[view];
                    *(if side == 0 { &mut own.left } else { &mut own.right }) = corners.clone();
                    let (after, grade) = self.calibrate(&pairs);
                    assert!(grade > Grade::Good, "view {}", self.views[view]);
                    tries.push((after.views[view].moved, before.views[view].moved));
                }
            }
        }
        tries
    }
}

#[test]
fn a_board_at_rest_is_good_until_a_picture_is_shifted() {
    let _turn = turns::beside_others();
    let Some(folder) = shared_data("chessboard_sg1") else { return };
    let set = Set::new(&folder, &RESTING);
    let (c, grade) = set.calibrate(&set.pairs);
    assert_eq!(grade, Grade::Good);
    assert!((c.rectification.rig.baseline_m / 0.094 - 1.0).abs() < 0.005);
    let tries = set.tries();
    let named = tries.iter().filter(|t| t.0).count();
    println!("{named} of {} shifted pictures were named", tries.len());
    assert_eq!((named, tries.len()), (104, 104));
}

#[test]
fn in_a_set_from_a_hand_each_view_that_agrees_is_named_when_it_is_shifted() {
    let _turn = turns::beside_others();
    let Some(folder) = shared_data("chessboard_sg1") else { return };
    let views: Vec<usize> = (1..=VIEWS).collect();
    let set = Set::new(&folder, &views);
    // Offsets of similar views differ as much as those of any views: the board moved. A lens, board or corner that
    // deviates from the camera model would shift similar views alike.
    let [near, all] = set.differences();
    println!("offsets of views alike differ by {near:.2?}, of any by {all:.2?} px");
    assert!(near.x > 0.8 * all.x && near.y > 0.8 * all.y, "{near:?} {all:?}");
    let tries = set.tries();
    for (way, words) in ["right", "left", "down", "up"].into_iter().enumerate() {
        let own: Vec<_> = tries.iter().skip(way).step_by(WAYS.len()).collect();
        let agreed: Vec<_> = own.iter().filter(|t| !t.1).collect();
        let named = own.iter().filter(|t| t.0).count();
        let agreed_named = agreed.iter().filter(|t| t.0).count();
        println!(
            "{words}: {named} of {} named; {agreed_named} of {} that agreed before",
            own.len(),
            agreed.len()
        );
        // The other views were off by more than a quarter of a pixel, and named for that.
        assert!(agreed_named == agreed.len() && agreed.len() >= 32 && named >= 50, "{words}");
    }
}

#[test]
fn the_program_names_the_shifted_picture() {
    let Some(folder) = shared_data("chessboard_sg1") else { return };
    let bench = Bench::new();
    let own: PathBuf = bench.path("set");
    std::fs::create_dir_all(&own).unwrap();
    let path = |side: usize, view: usize| own.join(format!("{}{view}.png", SIDES[side]));
    let save = |side: usize, view: usize, pixels: &[u8]| {
        save_grey(&path(side, view), pixels, SIZE.0 as u32, SIZE.1 as u32);
    };
    let calibrate = || {
        let args = ["calibrate", "set", "--board", "9x6", "--square-mm", "24.23", "-o", "rig.toml", "--json"];
        let output = bench.run(&args);
        serde_json::from_slice::<serde_json::Value>(&output.stdout).unwrap()
    };
    for view in RESTING {
        for side in 0..2 {
            save(side, view, &picture(&folder, side, view));
        }
    }
    let json = calibrate();
    assert_eq!(json["verdict"], "good", "{json:#}");
    assert_eq!(json["moved"], serde_json::json!([]), "{json:#}");
    for (try_, view) in RESTING.into_iter().enumerate().take(8) {
        let (side, way) = (try_ / 4, WAYS[try_ % 4]);
        let pixels = picture(&folder, side, view);
        save(side, view, &shifted(&pixels, way));
        let json = calibrate();
        save(side, view, &pixels);
        assert_ne!(json["verdict"], "good", "{json:#}");
        let moved = json["moved"].as_array().unwrap();
        assert!(moved.contains(&format!("left{view}").into()), "view {view}: {json:#}");
    }
}
