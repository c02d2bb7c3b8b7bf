//! Writes views of a chessboard as two cameras see it, as grey bytes that `v4l2-ctl --stream-from` plays: for
//! `tests/board/tutorial.sh`. The cameras are those of the built-in scenes: 640 × 480 pixels, 12 cm apart, without lens
//! errors.
//!
//! ```sh
//! cargo run --release -p lookout-sources --example render_boards -- OUT [VIEWS]
//! ```

use lookout_sources::chessboard::{BoardRenderer, Conditions, poses};
use nalgebra::{Rotation3, Vector3};
use perception::calibration::{Board, Camera, Pose};
use std::path::Path;

/// Width and height of the pictures.
const SIZE: (usize, usize) = (640, 480);

/// Focal length of the cameras, in pixels.
const FOCAL_PX: f64 = 879.0;

/// Distance between the cameras, in metres.
const BASELINE_M: f64 = 0.12;

/// Nearest and farthest board, in metres.
const DISTANCES_M: (f64, f64) = (0.7, 1.25);

/// Views, unless the command names their number.
const VIEWS: usize = 16;

fn main() -> Result<(), Box<dyn std::error::Error>> {
    let mut arguments = std::env::args().skip(1);
    let out = arguments.next().ok_or("usage: render_boards OUT [VIEWS]")?;
    let views = arguments.next().map_or(Ok(VIEWS), |text| text.parse())?;
    std::fs::create_dir_all(&out)?;
    let camera = Camera::pinhole(FOCAL_PX, FOCAL_PX, 320.0, 220.0);
    let board = Board::new(9, 6, 0.025)?;
    let renderer = BoardRenderer::new(&camera, SIZE, board);
    let between =
        Pose { rotation: Rotation3::identity(), translation_m: Vector3::new(-BASELINE_M, 0.0, 0.0) };
    for (i, mut pose) in poses(views, DISTANCES_M, FOCAL_PX / SIZE.0 as f64, 3).into_iter().enumerate() {
        pose.translation_m.x += BASELINE_M / 2.0;
        for (side, pose) in [("left", pose), ("right", pose.then(&between))] {
            let seed = 2 * i as u64 + u64::from(side == "right");
            let picture = renderer.picture(&pose, &Conditions::default(), seed);
            std::fs::write(Path::new(&out).join(format!("{side}-{i:02}.GREY")), picture.as_slice())?;
        }
    }
    Ok(())
}
