//! `lookout point-cloud`: from two images to a file that other programs read.

use crate::support::Bench;
use sources::scene::Drive;

/// Points with their colours.
fn read(path: &std::path::Path) -> Vec<([f32; 3], [u8; 3])> {
    let bytes = std::fs::read(path).unwrap();
    let end = bytes.windows(11).position(|w| w == b"end_header\n").expect("a header") + 11;
    let header = String::from_utf8(bytes[..end].to_vec()).unwrap();
    assert!(header.starts_with("ply\nformat binary_little_endian 1.0\n"), "{header}");
    let count = header.lines().find_map(|l| l.strip_prefix("element vertex ")).expect("a count");
    let count: usize = count.parse().unwrap();
    assert_eq!(bytes.len() - end, 15 * count, "three floats and three bytes a point");
    let value = |p: &[u8], i: usize| f32::from_le_bytes(p[4 * i..4 * i + 4].try_into().unwrap());
    bytes[end..]
        .chunks_exact(15)
        .map(|p| ([value(p, 0), value(p, 1), value(p, 2)], [p[12], p[13], p[14]]))
        .collect()
}

#[test]
fn the_road_and_the_car_ahead_are_where_they_are() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let pair = ["drive/left/000000.png", "drive/right/000000.png", "--rig", "drive/rig.toml"];
    let run =
        |out: &str, more: &[&str]| bench.ok(&[&["point-cloud"], &pair[..], &["-o", out], more].concat());
    run("grey.ply", &[]);
    let grey = read(&bench.path("grey.ply"));
    assert!(grey.iter().all(|(_, [r, g, b])| r == g && g == b));
    // On the near road, camera's height below it.
    let near = grey.iter().filter(|([x, y, z], _)| x.abs() < 1.0 && *y > 0.9 && *z < 8.0);
    let heights: Vec<f32> = near.map(|([_, y, _], _)| *y).collect();
    let mean = heights.iter().sum::<f32>() / heights.len() as f32;
    assert!(
        heights.len() > 500 && (mean - Drive::CAMERA_HEIGHT_M as f32).abs() < 0.05,
        "{mean} of {}",
        heights.len()
    );
    // The rear of the car ahead, 16 m away as the recording begins.
    let ahead = grey.iter().filter(|([x, y, z], _)| x.abs() < 0.5 && (0.2..0.8).contains(y) && *z < 25.0);
    let mut distances: Vec<f32> = ahead.map(|([_, _, z], _)| *z).collect();
    distances.sort_by(f32::total_cmp);
    let median = distances[distances.len() / 2];
    assert!(distances.len() > 50 && (median - 16.0).abs() < 1.5, "{median} m of {}", distances.len());

    // Height: blue on the road, warmer above it.
    run("height.ply", &["--color", "height"]);
    let height = read(&bench.path("height.ply"));
    assert_eq!(height.len(), grey.len());
    let road = height.iter().filter(|([x, y, z], _)| x.abs() < 1.0 && (y - mean).abs() < 0.05 && *z < 8.0);
    assert!(road.clone().count() > 100 && road.clone().all(|(_, [r, _, b])| b > r), "the road is not blue");
    // Distance: red near, blue far.
    run("distance.ply", &["--color", "distance"]);
    let distance = read(&bench.path("distance.ply"));
    assert!(distance.iter().filter(|(p, _)| p[2] < 5.0).all(|(_, [r, _, b])| r > b));
    assert!(distance.iter().filter(|(p, _)| p[2] > 40.0).all(|(_, [r, _, b])| b > r));

    // Subsampled, limited in distance, and with all outliers.
    let tally: serde_json::Value =
        serde_json::from_str(&run("few.ply", &["--every", "4", "--distance-max", "20", "--json"])).unwrap();
    let few = read(&bench.path("few.ply"));
    assert!(few.len() * 12 < grey.len() && few.iter().all(|(p, _)| p[2] <= 20.0), "{}", few.len());
    assert_eq!(tally["points"], few.len());
    assert!(tally["far"].as_u64() > Some(0) && tally["road_seen"] == true, "{tally}");
    run("all.ply", &["--neighbours", "0"]);
    assert!(read(&bench.path("all.ply")).len() > grey.len());
}

#[test]
fn missing_input_is_named() {
    let bench = Bench::new();
    bench.record("drive", 1);
    let pair = ["point-cloud", "drive/left/000000.png", "drive/right/000000.png", "-o", "x.ply"];
    let rigless = bench.fails(&pair);
    assert!(rigless.contains("--rig"), "{rigless}");
    let nowhere = bench.fails(&[&pair[..3], &["-o", "no/such/x.ply", "--rig", "drive/rig.toml"]].concat());
    assert!(nowhere.contains("no/such/x.ply"), "{nowhere}");
    let none = bench.fails(&[&pair[..], &["--rig", "drive/rig.toml", "--distance-max", "0.2"]].concat());
    assert!(none.contains("no points remain") && none.contains("--distance-max"), "{none}");
    assert!(!bench.path("x.ply").exists());
}
