//! Time of visual odometry beside that of the matcher, on the same frames: `cargo bench -p lookout --bench motion
//! [-- SCENE [FRAMES]]`.
//!
//! Both run alternately on one core on a rendered drive of 640 × 480 px; medians of the frames after the first ten.

use perception::image::GreyView;
use perception::motion::odometry::{Odometry, OdometryResult};
use perception::stereo::{DisparityView, MatchOutput, Matcher, Mpv, MpvParameters, Search};
use sources::PairSource;
use sources::scene::Scene;
use std::time::Instant;

const DISPARITIES: usize = 64;
const WARM_UP: u64 = 10;

fn median(times: &mut [f64]) -> f64 {
    times.sort_unstable_by(f64::total_cmp);
    times[times.len() / 2]
}

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut given = std::env::args().skip(1).filter(|argument| !argument.starts_with('-'));
    let name = given.next().unwrap_or_else(|| "motion".to_owned());
    let frames: u64 = given.next().map_or(Ok(100), |count| count.parse())?;
    let mut scene = Scene::open(&name)?;
    let (width, height) = scene.size();
    let rig = scene.rig().ok_or("a scene has a rig")?;
    let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
    let (mut map, mut confidence) = (vec![0; width * height], vec![0; width * height]);
    let mut matcher = Mpv::new(MpvParameters::default(), Search::Windows, width, height, DISPARITIES)?;
    let mut odometry = Odometry::new(rig, width, height);
    let (mut stereo_ms, mut odometry_ms, mut known) = (Vec::new(), Vec::new(), 0);
    for index in 0..frames {
        scene.read(index, &mut left, &mut right)?;
        let view = |pixels| GreyView::new(pixels, width, height, width);
        let begin = Instant::now();
        let output = MatchOutput { disparity: &mut map, confidence: &mut confidence };
        matcher.compute(view(&left)?, view(&right)?, output)?;
        let matched = Instant::now();
        let disparity = DisparityView::new(&map, width, height).ok_or("one disparity per pixel")?;
        let elapsed_s = if index == 0 { 0.0 } else { scene.period_ns() as f64 * 1e-9 };
        let result = odometry.update(view(&left)?, disparity, elapsed_s);
        let done = Instant::now();
        known += u64::from(matches!(result, OdometryResult::Known(_)));
        if index >= WARM_UP {
            stereo_ms.push((matched - begin).as_secs_f64() * 1e3);
            odometry_ms.push((done - matched).as_secs_f64() * 1e3);
        }
    }
    let (stereo, own) = (median(&mut stereo_ms), median(&mut odometry_ms));
    println!("{name}, {width}x{height}, {frames} frames, motion known in {known}");
    println!("stereo   {stereo:6.2} ms (median)");
    println!(
        "odometry {own:6.2} ms (median), at most {:.2} ms; {:.1} % of stereo",
        odometry_ms[odometry_ms.len() - 1],
        100.0 * own / stereo
    );
    Ok(())
}
