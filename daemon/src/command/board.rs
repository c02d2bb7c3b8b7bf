//! `lookout board`: a calibration board to print. Also the arguments that describe a board.

use crate::command::calibrate::pair;
use crate::command::console::say;
use crate::command::error::CommandError;
use clap::{Args, ValueEnum};
use perception::calibration::{Board, Dictionary};
use std::path::PathBuf;
use tools::calibration::print;

/// Width of the black border of an AprilTag of an AprilGrid, in cells, as Kalibr prints it.
const BORDER_CELLS: usize = 2;

/// Gap between tags over their side, as Kalibr's examples have it.
const TAG_SPACING: f64 = 0.3;

/// Text below the options of `--help`.
pub const HELP: &str = "Examples:
  lookout board --board 9x6 --square-mm 25 -o board.svg
  lookout board --pattern charuco --board 10x7 --square-mm 22 --marker-mm 16.5 --dictionary 5x5_100 -o board.svg
  lookout board --pattern aprilgrid --board 6x4 --square-mm 33 -o board.svg

Print the file at 100 % (a browser does), on stiff and flat material, then measure a square: printers
scale. Of a ChArUco board or an AprilGrid each picture may show a part only, so that its corners reach
the borders of the picture: the better choice for wide-angle lenses.";

/// The printed pattern.
#[derive(Args, Clone, Debug)]
pub struct BoardArgs {
    /// What is printed
    #[arg(long, value_enum, default_value_t = PatternChoice::Chessboard)]
    pub pattern: PatternChoice,
    /// Number of inner corners of the board, where four squares meet; of an AprilGrid, number of tags
    #[arg(long, value_name = "COLSxROWS", value_parser = pair)]
    pub board: (usize, usize),
    /// Measured side length of a square, or of a tag, in mm
    #[arg(long, value_name = "S", value_parser = millimetres)]
    pub square_mm: f64,
    /// ChArUco: measured side length of a marker with its black border, in mm
    #[arg(long, value_name = "S", value_parser = millimetres, required_if_eq("pattern", "charuco"))]
    pub marker_mm: Option<f64>,
    /// ChArUco: where the markers are from: 4x4_50 to 7x7_1000 of OpenCV, or apriltag_36h11
    #[arg(long, value_name = "NAME", required_if_eq("pattern", "charuco"))]
    pub dictionary: Option<Dictionary>,
    /// ChArUco: the board begins with a white square, as OpenCV before 4.6 printed those with an even
    /// number of rows of squares
    #[arg(long)]
    pub legacy: bool,
    /// AprilGrid: gap between tags, relative to the side of a tag [default: 0.3]
    #[arg(long, value_name = "RATIO")]
    pub tag_spacing: Option<f64>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq, ValueEnum)]
pub enum PatternChoice {
    /// Black and white squares; seen whole
    Chessboard,
    /// A chessboard with a marker in each white square (OpenCV)
    Charuco,
    /// Kalibr's grid of AprilTags 36h11
    Aprilgrid,
}

impl BoardArgs {
    /// The board that the arguments describe.
    ///
    /// # Errors
    /// Names the arguments that are impossible.
    pub fn board(&self) -> Result<Board, CommandError> {
        let (size, square_m) = (self.board, 1e-3 * self.square_mm);
        let only = |given: bool, name: &str, pattern: PatternChoice| {
            let is_wrong = given && self.pattern != pattern;
            let of = if pattern == PatternChoice::Charuco { "charuco" } else { "aprilgrid" };
            let text = format!("{name} belongs to --pattern {of}: add that, or leave {name} out");
            if is_wrong { Err(CommandError::Other(text)) } else { Ok(()) }
        };
        only(self.marker_mm.is_some(), "--marker-mm", PatternChoice::Charuco)?;
        only(self.dictionary.is_some(), "--dictionary", PatternChoice::Charuco)?;
        only(self.legacy, "--legacy", PatternChoice::Charuco)?;
        only(self.tag_spacing.is_some(), "--tag-spacing", PatternChoice::Aprilgrid)?;
        let (board, names) = match self.pattern {
            PatternChoice::Chessboard => (Board::new(size.0, size.1, square_m), "--board, --square-mm"),
            PatternChoice::Charuco => {
                let (Some(marker_mm), Some(dictionary)) = (self.marker_mm, self.dictionary) else {
                    return Err(CommandError::Other("give --marker-mm and --dictionary of the board".into()));
                };
                let board = Board::charuco(size, square_m, 1e-3 * marker_mm, dictionary, self.legacy);
                (board, "--board, --square-mm, --marker-mm, --dictionary")
            }
            PatternChoice::Aprilgrid => (
                Board::april_grid(size, square_m, self.tag_spacing.unwrap_or(TAG_SPACING), BORDER_CELLS),
                "--board, --square-mm, --tag-spacing",
            ),
        };
        board.map_err(|error| CommandError::Other(format!("{names}: {error}")))
    }
}

fn millimetres(text: &str) -> Result<f64, String> {
    match text.parse::<f64>() {
        Ok(value) if (0.5..=2000.0).contains(&value) => Ok(value),
        _ => Err("give the measured side in mm, 0.5 to 2000".into()),
    }
}

#[derive(Args, Debug)]
pub struct PrintBoard {
    #[command(flatten)]
    pub board: BoardArgs,
    /// Output: SVG file, in true size
    #[arg(short, long, value_name = "FILE.svg")]
    pub out: PathBuf,
}

pub fn run(args: &PrintBoard) -> Result<(), CommandError> {
    let board = args.board.board()?;
    let out = &args.out;
    if !out.extension().is_some_and(|ending| ending.eq_ignore_ascii_case("svg")) {
        return Err(CommandError::Other(format!(
            "-o {}: the board is written as SVG, in true size: end the name in .svg",
            out.display()
        )));
    }
    std::fs::write(out, print::svg(&board)).map_err(|e| {
        CommandError::Other(format!("{}: {e}: give a file that can be written", out.display()))
    })?;
    let size_mm = board.size_m() * 1e3;
    say(format_args!(
        "{}: {:.0} x {:.0} mm without margins, for {}; calibrate with {}",
        out.display(),
        size_mm.x,
        size_mm.y,
        print::paper(&board)
            .map_or("paper larger than A0".to_owned(), |paper| format!("paper of size {paper} or larger")),
        print::described(&board)
    ))
}
