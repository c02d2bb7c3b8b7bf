//! Renders pairs of a scene and prints the processor time per pair (on Linux):
//! `cargo run --release -p lookout-sources --example render_scene street?weather=night 40 out`.

use image::{GrayImage, Luma};
use lookout_sources::PairSource;
use lookout_sources::scene::Scene;
use std::error::Error;
use std::path::PathBuf;

/// Processor time of this process so far, in milliseconds.
fn cpu_ms() -> Result<f64, Box<dyn Error>> {
    let text = std::fs::read_to_string("/proc/self/schedstat")?;
    let ns: f64 = text.split_whitespace().next().ok_or("schedstat is empty")?.parse()?;
    Ok(ns * 1e-6)
}

fn main() -> Result<(), Box<dyn Error>> {
    let mut args = std::env::args().skip(1);
    let name = args.next().unwrap_or_else(|| "street".into());
    let index: u64 = args.next().map_or(Ok(0), |text| text.parse())?;
    let out = PathBuf::from(args.next().unwrap_or_else(|| ".".into()));
    let mut scene = Scene::open(&name)?;
    let (width, height) = scene.size();
    let (mut left, mut right) = (vec![0; width * height], vec![0; width * height]);
    let mut times_ms = Vec::new();
    for _ in 0..9 {
        let start = cpu_ms()?;
        scene.read(index, &mut left, &mut right)?;
        times_ms.push(cpu_ms()? - start);
    }
    times_ms.sort_by(f64::total_cmp);
    println!("{}: {:.1} ms of processor time per pair (median of 9)", scene.title(), times_ms[4]);
    let frame = scene.frame(index);
    for object in frame.truth.objects.iter().filter(|object| object.subject || object.distance_m < 40.0) {
        println!(
            "{:>4} {:<10} {} {:6.2} m  {:+5.2} m  {:4.2}x{:4.2} m  {:?} {} px, {:.0} % free, {:.0} % in both{}{}",
            object.id,
            object.class.name(),
            if object.subject { "*" } else { " " },
            object.distance_m,
            object.lateral_m,
            object.width_m,
            object.height_m,
            object.bounds,
            object.pixels,
            100.0 * object.visible,
            100.0 * object.seen_by_both,
            if object.in_path { ", in the path" } else { "" },
            if object.on_road { ", on the road" } else { "" },
        );
    }
    let size = (width as u32, height as u32);
    let save = |pixels: Vec<u8>, name: &str| -> Result<(), Box<dyn Error>> {
        let image = GrayImage::from_raw(size.0, size.1, pixels)
            .ok_or("pixel buffer does not match the image size")?;
        image.save(out.join(name))?;
        Ok(())
    };
    save(frame.left, "left.png")?;
    save(frame.right, "right.png")?;
    let steps = |&d: &f32| (d * 256.0).round().min(65_535.0) as u16;
    let map: Vec<u16> = frame.truth.disparity_px.iter().map(steps).collect();
    image::ImageBuffer::<Luma<u16>, _>::from_raw(size.0, size.1, map)
        .ok_or("pixel buffer does not match the image size")?
        .save(out.join("disparity.png"))?;
    save(frame.truth.in_both.iter().map(|&both| if both { 255 } else { 0 }).collect(), "in_both.png")
}
