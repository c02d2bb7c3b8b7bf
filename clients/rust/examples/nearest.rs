//! Prints the nearest obstacle in the path of each frame: `cargo run -p lookout-client --example nearest [INSTANCE [DIRECTORY [FRAMES]]]`.

use lookout_client::{Client, Options};
use std::time::Duration;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let instance = arguments.next().unwrap_or_else(|| Options::default().instance);
    let directory = arguments.next().unwrap_or_default().into();
    let frames = arguments.next().map_or(Ok(usize::MAX), |text| text.parse())?;

    let mut client = Client::open(Options { instance, directory, pictures: true })?;
    for _ in 0..frames {
        let Some(frame) = client.next(Duration::from_secs(60))? else { return Err(client.waits().into()) };
        let known =
            frame.pictures.map_or(0, |pictures| pictures.disparity.iter().filter(|&&d| d > 0).count());
        let Some(obstacle) = frame.obstacles.iter().find(|o| o.track == frame.alarm.object) else { continue };
        println!("{} {} {:.1} m, {known} disparities", frame.sequence, frame.level(), obstacle.distance_m);
    }
    Ok(())
}
