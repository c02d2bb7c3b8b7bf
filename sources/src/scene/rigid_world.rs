//! Tests: the static world is rigid, and the pose of the ground truth is that of the camera.

use super::truth::{FIRST_OBJECT, ROAD, VERGE};
use super::{Scene, SceneFrame, SceneTruth, file, sensor};
use perception::motion::pose::Pose;
use perception::rig::Rig;

/// Mean and tolerance of the comparison of two frames.
#[derive(Debug, Default)]
struct Comparison {
    compared: usize,
    /// Median absolute difference of the disparities, in px.
    median_px: f64,
    /// Share of differences above 0.05 px.
    off: f64,
    /// Mean absolute difference of the grey values of the ground.
    grey: f64,
}

/// The four pixels around a position, if all belong to `owner`, and the position between them.
fn around(truth: &SceneTruth, u: f64, v: f64, owner: u16) -> Option<([usize; 4], f64, f64)> {
    let (x, y) = (u.floor(), v.floor());
    if x < 0.0 || y < 0.0 || x as usize + 1 >= truth.width || y as usize + 1 >= truth.height {
        return None;
    }
    let i = y as usize * truth.width + x as usize;
    let pixels = [i, i + 1, i + truth.width, i + truth.width + 1];
    pixels.iter().all(|&k| truth.owner[k] == owner).then_some((pixels, u - x, v - y))
}

fn between(values: [f64; 4], a: f64, b: f64) -> f64 {
    let top = values[0] + (values[1] - values[0]) * a;
    let low = values[2] + (values[3] - values[2]) * a;
    top + (low - top) * b
}

/// Transforms the static points of one frame into the camera of another by `motion`, and compares.
fn compare(rig: &Rig, from: &SceneFrame, to: &SceneFrame, motion: &Pose) -> Comparison {
    let (a, b) = (&from.truth, &to.truth);
    let scale = rig.focal_px * rig.baseline_m;
    let named: Vec<u16> = a.objects.iter().filter(|o| o.subject).map(|o| o.id).collect();
    let (mut errors, mut grey, mut ground) = (Vec::new(), 0.0, 0);
    for i in 0..a.width * a.height {
        let (owner, d) = (a.owner[i], f64::from(a.disparity_px[i]));
        if owner == 0 || d < 1.0 || named.contains(&owner) {
            continue;
        }
        let z = scale / d;
        let (x, y) = ((i % a.width) as f64 - rig.cx_px, (i / a.width) as f64 - rig.cy_px);
        let [px, py, pz] = motion.apply([x * z / rig.focal_px, y * z / rig.focal_px, z]);
        if pz < 1.0 {
            continue;
        }
        let (u, v) = (rig.cx_px + rig.focal_px * px / pz, rig.cy_px + rig.focal_px * py / pz);
        let Some((pixels, s, t)) = around(b, u, v, owner) else { continue };
        errors.push((between(pixels.map(|k| f64::from(b.disparity_px[k])), s, t) - scale / pz).abs());
        if owner == ROAD || owner == VERGE {
            let seen = between(pixels.map(|k| f64::from(to.left[k])), s, t);
            grey += (seen - f64::from(from.left[i])).abs();
            ground += 1;
        }
    }
    errors.sort_unstable_by(f64::total_cmp);
    let off = errors.iter().filter(|&&e| e > 0.05).count();
    Comparison {
        compared: errors.len(),
        median_px: errors[errors.len() / 2],
        off: off as f64 / errors.len() as f64,
        grey: grey / f64::from(ground.max(1)),
    }
}

/// A scene without noise.
fn quiet(scene: file::SceneFile) -> Scene {
    let mut scene = Scene::new(scene).unwrap();
    let sensor = sensor::Sensor { gain: 1.0, offset: 0.0, noise: 0.0, shot_noise: 0.0 };
    scene.world.conditions.sensors = [sensor; 2];
    scene
}

#[test]
fn the_static_world_moves_as_the_pose_says() {
    // Bends, a junction, a stop, and sway (motion); a bend, a wide rig, a straight road with sway.
    let cases: [(&str, &[(u64, u64)]); 6] = [
        ("motion", &[(55, 56), (105, 109), (225, 226), (240, 243), (345, 350), (490, 492)]),
        ("junction-parked", &[(60, 61), (75, 78)]),
        ("bend", &[(40, 41), (60, 63)]),
        ("bend-parked?rig=kitti", &[(50, 51), (60, 65)]),
        ("street", &[(60, 61), (60, 62)]),
        ("slope", &[(20, 23)]),
    ];
    for (name, pairs) in cases {
        let mut scene = quiet(super::library::load(name).unwrap());
        let rig = scene.world.rig;
        for &(i, j) in pairs {
            let (from, to) = (scene.frame(i), scene.frame(j));
            let motion = to.truth.motion.pose.inverse().after(&from.truth.motion.pose);
            let found = compare(&rig, &from, &to, &motion);
            println!("{name} {i} {j}: {found:?}");
            assert!(found.compared > 60_000, "{name} {i} {j}: {found:?}");
            assert!(found.median_px < 1e-5 && found.off < 0.01, "{name} {i} {j}: {found:?}");
            // The texture of the ground moves with it.
            assert!(found.grey < 3.0, "{name} {i} {j}: {found:?}");
            // The comparison is sensitive: 0.2 degrees of yaw are much worse.
            let wrong = Pose::from_rotation_vector([0.0, 0.2_f64.to_radians(), 0.0]).after(&motion);
            let wrong = compare(&rig, &from, &to, &wrong);
            println!("   0.2 degrees off: {wrong:?}");
            assert!(wrong.grey > 1.6 * found.grey, "{name} {i} {j}: {wrong:?}");
        }
    }
}

#[test]
fn the_pose_adds_up_from_speed_and_yaw_rate() {
    let mut scene = Scene::open("motion").unwrap();
    let period_s = 0.08;
    let (mut x, mut z, mut yaw) = (0.0, 0.0, 0.0);
    let mut before = scene.world.motion(0.0);
    let mut fastest: f64 = 0.0;
    for index in 1..560 {
        scene.world.place(scene.time_s(index));
        let now = scene.world.motion(scene.time_s(index));
        let middle = scene.world.motion(scene.time_s(index) - 0.5 * period_s);
        let turn =
            period_s * (before.yaw_rate_rad_s + 4.0 * middle.yaw_rate_rad_s + now.yaw_rate_rad_s) / 6.0;
        let heading: f64 = yaw + 0.5 * turn;
        (x, z) = (
            x - middle.speed_m_s * period_s * heading.sin(),
            z + middle.speed_m_s * period_s * heading.cos(),
        );
        yaw += turn;
        fastest = fastest.max(now.yaw_rate_rad_s.abs());
        let at = now.pose.translation_m;
        assert!((at[0] - x).abs() < 0.15 && (at[2] - z).abs() < 0.15, "{index}: {at:?} {x} {z}");
        assert!((now.pose.yaw_rad() - yaw).sin().abs() < 0.01, "{index}: {} {yaw}", now.pose.yaw_rad());
        before = now;
    }
    // Turned right by a quarter at the first junction: more than 0.4 rad/s.
    assert!(fastest > 0.4, "{fastest}");
}

#[test]
fn objects_in_a_bend_are_in_the_path_by_the_way_that_the_vehicle_takes() {
    let mut stopped = Scene::open("bend-stopped").unwrap();
    let target = stopped.target().expect("the car in the lane");
    let mut seen = 0;
    for index in 0..stopped.world.file.seconds as u64 * 12 {
        let truth = stopped.truth(index);
        let way = 72.0 - 11.0 * truth.time_s;
        if let Some(car) = truth.objects.iter().find(|o| o.id == target) {
            assert!(car.in_path, "{index}");
            // The way is that of our lane, on the outside of the bend; along the camera's axis it is nearer.
            let ttc = car.along_m / car.closing_m_s;
            // Speed is given along the road: on the outside the vehicle is 3 % faster, from the bend on.
            let tolerance_s = if truth.time_s < 3.0 { 0.15 } else { 0.03 };
            assert!((ttc - way / 11.0).abs() < tolerance_s, "{index}: {ttc} {}", way / 11.0);
            assert!(car.distance_m < car.along_m + 0.01, "{index}: {car:?}");
            assert!((10.99..11.4).contains(&car.closing_m_s), "{index}: {car:?}");
            seen += 1;
        }
    }
    assert!(seen > 30, "{seen}");
    // The same places on the straight strip would be the other way round: these cars stand straight ahead at times.
    for name in [
        "bend-parked",
        "bend-parked-left",
        "bend-overtaking",
        "bend-overtaken",
        "bend-oncoming",
        "junction-parked",
    ] {
        let mut scene = Scene::open(name).unwrap();
        assert_eq!(scene.target(), None, "{name}");
        let count = scene.world.file.seconds * 12.5;
        let mut straight = 0;
        for index in 0..count as u64 {
            let truth = scene.truth(index);
            for object in truth.objects.iter().filter(|o| o.subject) {
                assert!(!object.in_path, "{name} {index}: {object:?}");
                straight += usize::from(object.lateral_m.abs() - 0.5 * object.width_m < 1.2);
            }
        }
        println!("{name}: {straight} objects in the straight strip");
        assert!(straight > 5 || name == "bend-overtaken", "{name}: {straight}");
    }
}

#[test]
fn a_target_is_the_named_object_in_the_path() {
    for (name, is_target) in [
        ("bus", true),
        ("car-body", true),
        ("green-belt", true),
        ("cone", true),
        ("car-rear", true),
        ("debris", true),
        ("stopped-car", true),
        ("crest", false),
        ("bend", false),
        ("overtaken", false),
        ("next-lane", false),
        ("bridge", false),
        ("drive", true),
    ] {
        let mut scene = Scene::open(name).unwrap();
        let target = scene.target();
        // What the first frame shows in the path of a straight road is the same.
        let truth = scene.truth(0);
        let wanted =
            |o: &&super::ObjectTruth| o.subject && o.in_path && o.class != super::ObjectClass::Bridge;
        assert_eq!(target, truth.objects.iter().find(wanted).map(|o| o.id), "{name}");
        assert_eq!(target.is_some(), is_target, "{name}");
        assert!(target.is_none_or(|id| id >= FIRST_OBJECT), "{name}");
    }
}

#[test]
fn changing_lanes_turns_the_vehicle() {
    let text = "title = \"x\"\nseconds = 6\nseed = 3\n[ego]\nspeed_m_s = 9\nlateral_m = [[1, 0], [3.5, 3.5]]\n\
                [[beside]]\nkind = \"buildings\"\nlateral_m = -9\nfrom_m = -10\nto_m = 200\n\
                [[beside]]\nkind = \"trees\"\nlateral_m = 8\nfrom_m = -10\nto_m = 200\n";
    let mut scene = quiet(file::SceneFile::parse(text, "x.toml").unwrap());
    let rig = scene.world.rig;
    let (from, to) = (scene.frame(25), scene.frame(28));
    assert!(from.truth.motion.pose.yaw_rad() < -0.1, "to the right");
    let motion = to.truth.motion.pose.inverse().after(&from.truth.motion.pose);
    let found = compare(&rig, &from, &to, &motion);
    println!("{found:?}");
    assert!(found.median_px < 1e-5 && found.off < 0.005 && found.grey < 3.0, "{found:?}");
}

#[test]
fn the_sun_stands_still_while_the_vehicle_turns() {
    let mut scene = Scene::open("motion?weather=backlight").unwrap();
    scene.world.place(0.0);
    let ahead = (scene.world.light.towards_sun, scene.world.glare);
    // After the first junction we drive to the right: the sun stands on the left, out of the lens.
    scene.world.place(24.0);
    let beside = (scene.world.light.towards_sun, scene.world.glare);
    assert!(ahead.0[2] > 0.9 && ahead.1.is_some(), "{ahead:?}");
    assert!(beside.0[0] < -0.9 && beside.1.is_none(), "{beside:?}");
}
