//! Matching of detected regions with the ground truth of a synthetic scene.
//!
//! **Evaluable** are the objects that a scene lists (not the rows beside the road), except bridges, whose
//! nearest visible point is 3 to 40 m away (debris: 20 m), of which at least 40 pixels (debris: 12) are
//! visible, of which at least half is visible in both images, and which the left and right image borders do
//! not truncate.
//!
//! An evaluable object is a **true positive** if there is a region whose distance is within 1 m or 15 % of the
//! true one (whichever is more) and whose box overlaps the box of the object's visible pixels by 0.25
//! (intersection over union), or contains at least half of it and is at most six times as large. If the object
//! touches another one at a distance within the same tolerance, which a stereo camera cannot separate, the
//! region may also be up to 1.5 times as large as the box of both.
//!
//! A region is **matched** when it matches an evaluable object, or when at least a tenth of its box's pixels show
//! an object, including the rows beside the road, whose distance is within 1.5 m or 20 % of the region's. An
//! unmatched region within 40 m is a **false positive** where its foot is on the asphalt, and an **off-road false
//! positive** elsewhere.

use perception::region::PixelBox;
use sources::scene::truth::{FIRST_OBJECT, ROAD};
use sources::scene::{ObjectClass, ObjectTruth, SceneTruth};

/// Distance range of evaluable objects, in metres.
pub const EVALUABLE_M: (f64, f64) = (3.0, 40.0);

/// Objects at most this many columns or rows apart touch each other.
const TOUCHING_PX: u32 = 4;

/// A detected region or track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Detection {
    /// Bounding box in the left image.
    pub bounds: PixelBox,
    /// Distance in metres.
    pub distance_m: f64,
    /// Standard deviation of the distance, in metres.
    pub sigma_m: f64,
}

/// An evaluable object with the region that matches it.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Evaluable {
    /// The object.
    pub object: ObjectTruth,
    /// The region that overlaps it most, among those that match.
    pub detection: Option<Detection>,
}

/// Numbers of unmatched regions of a frame within 40 m.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FalsePositives {
    /// Those that stand on the asphalt.
    pub on_road: usize,
    /// The others.
    pub off_road: usize,
}

/// Result of matching one frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct FrameMatch {
    /// The evaluable objects.
    pub evaluable: Vec<Evaluable>,
    /// For each region, whether it is matched.
    pub matched: Vec<bool>,
    /// Unmatched regions.
    pub false_positives: FalsePositives,
    /// Evaluable objects that are found if a region may find one object only: the greatest number.
    pub one_to_one: usize,
    /// Regions on the evaluable objects that are found: the one that finds each, and those at least half of whose box lies
    /// within the object's, at its distance.
    pub boxes: usize,
}

/// Whether an object is evaluable, in an image of `width` pixels.
pub fn is_evaluable(object: &ObjectTruth, width: usize) -> bool {
    let small = object.class == ObjectClass::Debris;
    let (farthest, pixels) = if small { (20.0, 12) } else { (EVALUABLE_M.1, 40) };
    let cut = object.bounds.x == 0 || object.bounds.x + object.bounds.width >= width as u32;
    object.subject
        && object.class != ObjectClass::Bridge
        && (EVALUABLE_M.0..=farthest).contains(&object.distance_m)
        && object.visible >= 0.5
        && object.pixels >= pixels
        && object.visible * object.seen_by_both >= 0.5
        && !cut
}

/// Whether a region matches an object in position and distance.
pub fn is_match(object: &ObjectTruth, found: &Detection) -> bool {
    is_match_among(object, &[], found)
}

/// The same, given all objects of the frame.
fn is_match_among(object: &ObjectTruth, all: &[ObjectTruth], found: &Detection) -> bool {
    let tolerance = tolerance_m(object);
    let (a, b) = (&found.bounds, &object.bounds);
    let shared = shared_area(a, b);
    let own = f64::from(b.width) * f64::from(b.height);
    let area = f64::from(a.width) * f64::from(a.height);
    (found.distance_m - object.distance_m).abs() <= tolerance
        && (a.overlap(b) >= 0.25
            || (shared >= 0.5 * own
                && (area <= 6.0 * own
                    || all.iter().any(|other| {
                        is_one_with(object, other) && area <= 1.5 * area_of_both(b, &other.bounds)
                    }))))
}

fn tolerance_m(object: &ObjectTruth) -> f64 {
    (0.15 * object.distance_m).max(1.0)
}

/// Whether two objects touch in the image and cannot be separated by disparity.
fn is_one_with(object: &ObjectTruth, other: &ObjectTruth) -> bool {
    let (a, b) = (&object.bounds, &other.bounds);
    let near = |a: u32, al: u32, b: u32, bl: u32| a <= b + bl + TOUCHING_PX && b <= a + al + TOUCHING_PX;
    other.id != object.id
        && other.subject
        && other.pixels > 0
        && (other.distance_m - object.distance_m).abs() <= tolerance_m(object)
        && near(a.x, a.width, b.x, b.width)
        && near(a.y, a.height, b.y, b.height)
}

fn area_of_both(a: &PixelBox, b: &PixelBox) -> f64 {
    let span = |a: u32, al: u32, b: u32, bl: u32| f64::from((a + al).max(b + bl) - a.min(b));
    span(a.x, a.width, b.x, b.width) * span(a.y, a.height, b.y, b.height)
}

/// Area that two boxes share, in pixels.
pub fn shared_area(a: &PixelBox, b: &PixelBox) -> f64 {
    let span = |a: u32, al: u32, b: u32, bl: u32| f64::from((a + al).min(b + bl).saturating_sub(a.max(b)));
    span(a.x, a.width, b.x, b.width) * span(a.y, a.height, b.y, b.height)
}

/// Matches the regions of a frame with its ground truth. `focal_baseline` is focal length × baseline, in
/// px · m.
pub fn match_frame(truth: &SceneTruth, focal_baseline: f64, found: &[Detection]) -> FrameMatch {
    let evaluable = truth.objects.iter().filter(|object| is_evaluable(object, truth.width)).map(|&object| {
        let by = found.iter().filter(|found| is_match_among(&object, &truth.objects, found));
        let best =
            by.max_by(|a, b| a.bounds.overlap(&object.bounds).total_cmp(&b.bounds.overlap(&object.bounds)));
        Evaluable { object, detection: best.copied() }
    });
    let mut result = FrameMatch { evaluable: evaluable.collect(), ..FrameMatch::default() };
    let finders: Vec<Vec<usize>> =
        result.evaluable.iter().map(|e| finders(&e.object, truth, found)).collect();
    result.one_to_one = most_pairs(&finders, found.len());
    result.boxes = result.evaluable.iter().map(|evaluable| boxes_on(evaluable, found)).sum();
    for region in found {
        let finds = |evaluable: &Evaluable| is_match_among(&evaluable.object, &truth.objects, region);
        let is_matched = shows_object(truth, focal_baseline, region) || result.evaluable.iter().any(finds);
        result.matched.push(is_matched);
        if !is_matched && region.distance_m <= EVALUABLE_M.1 {
            if stands_on_road(truth, region) {
                result.false_positives.on_road += 1;
            } else {
                result.false_positives.off_road += 1;
            }
        }
    }
    result
}

/// The regions that find an object, best first.
fn finders(object: &ObjectTruth, truth: &SceneTruth, found: &[Detection]) -> Vec<usize> {
    let is_finder = |k: &usize| is_match_among(object, &truth.objects, &found[*k]);
    let mut finders: Vec<usize> = (0..found.len()).filter(is_finder).collect();
    let overlap = |k: usize| found[k].bounds.overlap(&object.bounds);
    finders.sort_by(|&a, &b| overlap(b).total_cmp(&overlap(a)));
    finders
}

/// The greatest number of pairs of objects and regions, each in one pair only: augmenting paths.
fn most_pairs(finders: &[Vec<usize>], regions: usize) -> usize {
    fn give(object: usize, finders: &[Vec<usize>], owner: &mut [Option<usize>], tried: &mut [bool]) -> bool {
        for &region in &finders[object] {
            if std::mem::replace(&mut tried[region], true) {
                continue;
            }
            if owner[region].is_none_or(|other| give(other, finders, owner, tried)) {
                owner[region] = Some(object);
                return true;
            }
        }
        false
    }
    let mut owner = vec![None; regions];
    (0..finders.len()).filter(|&object| give(object, finders, &mut owner, &mut vec![false; regions])).count()
}

/// Regions on an object that is found.
fn boxes_on(evaluable: &Evaluable, found: &[Detection]) -> usize {
    let Some(best) = evaluable.detection else { return 0 };
    let object = &evaluable.object;
    let is_fragment = |region: &&Detection| {
        let own = f64::from(region.bounds.width) * f64::from(region.bounds.height);
        **region != best
            && (region.distance_m - object.distance_m).abs() <= tolerance_m(object)
            && shared_area(&region.bounds, &object.bounds) >= 0.5 * own
    };
    1 + found.iter().filter(is_fragment).count()
}

fn shows_object(truth: &SceneTruth, focal_baseline: f64, region: &Detection) -> bool {
    let tolerance = (0.2 * region.distance_m).max(1.5);
    let near = region.distance_m - tolerance;
    let most = if near > 0.0 { (focal_baseline / near) as f32 } else { f32::INFINITY };
    let least = (focal_baseline / (region.distance_m + tolerance)) as f32;
    let (mut there, mut all) = (0_u32, 0_u32);
    for y in rows(&region.bounds, truth.height) {
        for x in columns(&region.bounds, truth.width) {
            let i = y * truth.width + x;
            all += 1;
            there +=
                u32::from(truth.owner[i] >= FIRST_OBJECT && (least..=most).contains(&truth.disparity_px[i]));
        }
    }
    all > 0 && 10 * there >= all
}

/// Whether the lowest tenth of a box shows asphalt.
fn stands_on_road(truth: &SceneTruth, region: &Detection) -> bool {
    let b = &region.bounds;
    let foot = PixelBox { y: b.y + b.height - b.height.div_ceil(10), height: b.height.div_ceil(10), ..*b };
    let (mut road, mut all) = (0_u32, 0_u32);
    for y in rows(&foot, truth.height) {
        for x in columns(&foot, truth.width) {
            all += 1;
            road += u32::from(truth.owner[y * truth.width + x] == ROAD);
        }
    }
    2 * road >= all
}

fn rows(b: &PixelBox, height: usize) -> std::ops::Range<usize> {
    (b.y as usize).min(height)..((b.y + b.height) as usize).min(height)
}

fn columns(b: &PixelBox, width: usize) -> std::ops::Range<usize> {
    (b.x as usize).min(width)..((b.x + b.width) as usize).min(width)
}

/// Height errors of a road model: for each row known to both, the height of the model's road above the true
/// surface, in metres. `profile_px` is the disparity of the model per row (0 = none), `rows_px` the true one.
/// Only rows nearer than `farthest_m` count.
pub fn road_errors(
    profile_px: &[f32],
    rows_px: &[f32],
    baseline_m: f64,
    focal_baseline: f64,
    farthest_m: f64,
    errors_m: &mut Vec<f64>,
) {
    for (y, &model) in profile_px.iter().enumerate() {
        if f64::from(model) * farthest_m < focal_baseline {
            continue;
        }
        // The row in which the true road has this disparity; disparity increases downwards.
        let below = rows_px.iter().position(|&d| d >= model && d > 0.0);
        let Some(k) = below.filter(|&k| k > 0 && rows_px[k - 1] > 0.0) else { continue };
        let (a, b) = (rows_px[k - 1], rows_px[k]);
        let row = (k - 1) as f64 + f64::from((model - a) / (b - a).max(1e-6));
        errors_m.push(baseline_m * (row - y as f64) / f64::from(model));
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const SCALE: f64 = 100.0;

    /// A road with a car of 20 × 20 px at 10 m.
    fn truth() -> SceneTruth {
        let (width, height) = (100, 80);
        let mut truth = SceneTruth { width, height, ..SceneTruth::default() };
        truth.owner = vec![ROAD; width * height];
        truth.disparity_px = (0..width * height).map(|i| (i / width) as f32 * 0.3).collect();
        for y in 30..50 {
            for x in 40..60 {
                truth.owner[y * width + x] = FIRST_OBJECT;
                truth.disparity_px[y * width + x] = 10.0;
            }
        }
        truth.objects.push(ObjectTruth {
            id: FIRST_OBJECT,
            class: ObjectClass::Car,
            subject: true,
            distance_m: 10.0,
            lateral_m: 0.0,
            width_m: 1.8,
            height_m: 1.5,
            along_m: 10.0,
            closing_m_s: 0.0,
            bounds: PixelBox { x: 40, y: 30, width: 20, height: 20 },
            pixels: 400,
            visible: 1.0,
            seen_by_both: 1.0,
            in_path: true,
            on_road: true,
        });
        truth
    }

    fn found(x: u32, y: u32, width: u32, height: u32, distance_m: f64) -> Detection {
        Detection { bounds: PixelBox { x, y, width, height }, distance_m, sigma_m: 0.2 }
    }

    #[test]
    fn place_and_distance_must_both_fit() {
        let object = truth().objects[0];
        assert!(is_match(&object, &found(42, 32, 20, 20, 10.9)));
        assert!(!is_match(&object, &found(42, 32, 20, 20, 11.6)), "too far");
        assert!(!is_match(&object, &found(58, 32, 20, 20, 10.0)), "beside it");
        assert!(is_match(&object, &found(30, 20, 40, 40, 10.0)), "larger, and around it");
        assert!(!is_match(&object, &found(0, 0, 100, 80, 10.0)), "a box of the whole image matches nothing");
    }

    #[test]
    fn what_touches_at_one_distance_may_be_found_as_one() {
        let mut truth = truth();
        let bounds = PixelBox { x: 60, y: 44, width: 6, height: 6 };
        let block =
            ObjectTruth { id: FIRST_OBJECT + 1, bounds, pixels: 50, distance_m: 10.5, ..truth.objects[0] };
        truth.objects.push(block);
        let both = found(41, 30, 24, 20, 10.2);
        let blocks = |truth: &SceneTruth, region| match_frame(truth, SCALE, &[region]).evaluable[1].detection;
        assert_eq!(blocks(&truth, both), Some(both));
        assert_eq!(blocks(&truth, found(41, 30, 20, 20, 10.2)), None, "it must contain the object");
        assert_eq!(blocks(&truth, found(10, 10, 80, 60, 10.2)), None, "it must not be too large");
        truth.objects[1].distance_m = 12.0;
        assert_eq!(blocks(&truth, found(41, 30, 24, 20, 11.0)), None, "another distance");
        truth.objects[1] = ObjectTruth { bounds: PixelBox { x: 66, ..bounds }, ..block };
        assert_eq!(blocks(&truth, found(41, 30, 30, 20, 10.2)), None, "they do not touch");
    }

    #[test]
    fn a_region_finds_one_object_only_by_the_strict_rule() {
        let mut truth = truth();
        let bounds = PixelBox { x: 60, y: 44, width: 6, height: 6 };
        let block =
            ObjectTruth { id: FIRST_OBJECT + 1, bounds, pixels: 50, distance_m: 10.5, ..truth.objects[0] };
        truth.objects.push(block);
        let both = found(41, 30, 24, 20, 10.2);
        let found_by = |regions: &[Detection]| {
            let result = match_frame(&truth, SCALE, regions);
            let today = result.evaluable.iter().filter(|e| e.detection.is_some()).count();
            (today, result.one_to_one, result.boxes)
        };
        assert_eq!(found_by(&[both]), (2, 1, 2));
        // The second region finds the block alone; the first one is then the car's.
        assert_eq!(found_by(&[both, found(60, 44, 6, 6, 10.5)]), (2, 2, 2));
        assert_eq!(found_by(&[found(60, 44, 6, 6, 10.5), both]), (2, 2, 2));
        assert_eq!(found_by(&[]), (0, 0, 0));
        // The car in three pieces of which one finds it.
        let pieces = [found(40, 30, 12, 20, 10.0), found(52, 30, 5, 20, 10.3), found(57, 30, 3, 20, 9.8)];
        truth.objects.pop();
        let result = match_frame(&truth, SCALE, &pieces);
        assert_eq!((result.one_to_one, result.boxes), (1, 3));
        assert_eq!(match_frame(&truth, SCALE, &[pieces[0], found(52, 30, 5, 20, 20.0)]).boxes, 1);
    }

    #[test]
    fn what_the_truth_cannot_explain_is_false_on_the_road() {
        let mut truth = truth();
        for i in 0..100 * 80 {
            if i % 100 < 10 {
                truth.owner[i] = sources::scene::truth::VERGE;
            }
        }
        let regions = [
            found(41, 31, 18, 19, 10.2),
            found(41, 31, 18, 19, 20.0),
            found(70, 40, 10, 10, 10.0),
            found(0, 40, 9, 10, 10.0),
            found(70, 40, 10, 10, 55.0),
        ];
        let result = match_frame(&truth, SCALE, &regions);
        assert_eq!(result.matched, [true, false, false, false, false]);
        // The second is in front of the car's foot; the fourth is beside the road; the last is too far.
        assert_eq!(result.false_positives, FalsePositives { on_road: 1, off_road: 2 });
        assert_eq!(result.evaluable.len(), 1);
        assert_eq!(result.evaluable[0].detection, Some(regions[0]));
        assert_eq!(match_frame(&truth, SCALE, &[]).evaluable[0].detection, None);
    }

    #[test]
    fn what_finds_something_is_not_false() {
        let mut truth = truth();
        // A pole whose box is mostly road.
        truth.objects[0].bounds = PixelBox { x: 50, y: 20, width: 8, height: 30 };
        truth.owner.fill(ROAD);
        for y in 20..50 {
            truth.owner[y * truth.width + 53] = FIRST_OBJECT;
        }
        let wide = found(40, 20, 20, 30, 10.0);
        let result = match_frame(&truth, SCALE, &[wide]);
        assert_eq!(
            (result.evaluable[0].detection, result.false_positives),
            (Some(wide), FalsePositives::default())
        );
        assert_eq!(match_frame(&truth, SCALE, &[found(20, 20, 20, 30, 10.0)]).false_positives.on_road, 1);
    }

    #[test]
    fn hidden_and_cut_objects_are_not_evaluable() {
        let object = truth().objects[0];
        assert!(is_evaluable(&object, 100));
        assert!(!is_evaluable(&ObjectTruth { visible: 0.4, ..object }, 100));
        assert!(
            !is_evaluable(&ObjectTruth { visible: 0.7, seen_by_both: 0.7, ..object }, 100),
            "less than half visible in both"
        );
        assert!(is_evaluable(&ObjectTruth { visible: 0.8, seen_by_both: 0.7, ..object }, 100));
        assert!(!is_evaluable(&ObjectTruth { distance_m: 41.0, ..object }, 100));
        assert!(!is_evaluable(&ObjectTruth { distance_m: 21.0, class: ObjectClass::Debris, ..object }, 100));
        assert!(!is_evaluable(&ObjectTruth { subject: false, ..object }, 100));
        assert!(!is_evaluable(&object, 60), "truncated by the border");
    }

    #[test]
    fn a_model_that_lies_too_high_has_that_error() {
        // Disparity 0.1 px a row below row 100: with a baseline of 0.12 m the camera is 1.2 m high.
        let rows: Vec<f32> = (0..480).map(|y| (y as f32 - 100.0).max(0.0) * 0.1).collect();
        let raised: Vec<f32> = rows.iter().map(|d| d * 1.05).collect();
        let mut errors = Vec::new();
        road_errors(&rows, &rows, 0.12, 105.0, 40.0, &mut errors);
        assert!(errors.len() > 300 && errors.iter().all(|e| e.abs() < 1e-5));
        errors.clear();
        road_errors(&raised, &rows, 0.12, 105.0, 40.0, &mut errors);
        // The model's camera is 1.2 ÷ 1.05 m high: its road is 5.7 cm above the true one.
        assert!(errors.iter().all(|e| (e - 0.0571).abs() < 1e-3), "{errors:?}");
    }
}
