//! A calibration board to print: an SVG file in true size.

use perception::calibration::{Board, Pattern};
use std::fmt::Write;

/// White paper around the pattern, in mm: the outermost squares need a border that tells them from the background.
const MARGIN_MM: f64 = 10.0;
/// Room for the line of text below, in mm.
const TEXT_MM: f64 = 6.0;

/// What the board is, in one line: for its lower edge, so that whoever finds it can calibrate with it.
pub fn described(board: &Board) -> String {
    let side_mm = (board.square_m() * 1e9).round() / 1e6;
    let (columns, rows) = (board.columns(), board.rows());
    match board.pattern() {
        Pattern::Chessboard => format!("chessboard: --board {columns}x{rows} --square-mm {side_mm}"),
        Pattern::Charuco { dictionary, marker_share, is_legacy } => format!(
            "ChArUco: --pattern charuco --board {columns}x{rows} --square-mm {side_mm} --marker-mm {} --dictionary {dictionary}{}",
            (side_mm * marker_share * 1e6).round() / 1e6,
            if is_legacy { " --legacy" } else { "" }
        ),
        Pattern::AprilGrid { spacing, .. } => format!(
            "AprilGrid 36h11: --pattern aprilgrid --board {}x{} --square-mm {side_mm} --tag-spacing {spacing}",
            columns / 2,
            rows / 2
        ),
    }
}

/// To a ten-thousandth of a millimetre.
fn mm(metres: f64) -> f64 {
    (metres * 1e7).round() / 1e4
}

/// Width and height of the print with its margins, in mm.
fn page_mm(board: &Board) -> (f64, f64) {
    let size_mm = board.size_m().map(mm);
    (size_mm.x + 2.0 * MARGIN_MM, size_mm.y + 2.0 * MARGIN_MM + TEXT_MM)
}

/// The smallest paper that the print fits on, upright or across; `None` if it is larger than A0.
pub fn paper(board: &Board) -> Option<&'static str> {
    const PAPERS_MM: [(&str, f64, f64); 5] = [
        ("A4", 210.0, 297.0),
        ("A3", 297.0, 420.0),
        ("A2", 420.0, 594.0),
        ("A1", 594.0, 841.0),
        ("A0", 841.0, 1189.0),
    ];
    let (width, height) = page_mm(board);
    let fits = |paper: &&(&str, f64, f64)| width.min(height) <= paper.1 && width.max(height) <= paper.2;
    PAPERS_MM.iter().find(fits).map(|paper| paper.0)
}

/// The board as an SVG file whose units are millimetres.
pub fn svg(board: &Board) -> String {
    let (width, height) = page_mm(board);
    let mut text = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{width}mm\" height=\"{height}mm\" viewBox=\"0 0 {width} {height}\">\n\
         <rect width=\"{width}\" height=\"{height}\" fill=\"#fff\"/>\n<path shape-rendering=\"crispEdges\" d=\""
    );
    for [x, y, w, h] in board.dark_areas_m() {
        let (x, y) = (mm(x) + MARGIN_MM, mm(y) + MARGIN_MM);
        let _ = write!(text, "M{x} {y}h{}v{}h-{}z", mm(w), mm(h), mm(w));
    }
    let _ = write!(
        text,
        "\"/>\n<text x=\"{MARGIN_MM}\" y=\"{}\" font-family=\"sans-serif\" font-size=\"3\">{}. Print at 100 %, then measure.</text>\n</svg>\n",
        height - 0.5 * TEXT_MM,
        described(board)
    );
    text
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_print_has_its_true_size() {
        let text = svg(&Board::new(9, 6, 0.025).unwrap());
        assert!(text.contains("width=\"270mm\" height=\"201mm\""), "{}", &text[..200]);
        // The first square, and half of 10 x 7 squares.
        assert!(text.contains("d=\"M10 10h25v25h-25z"), "{}", &text[..400]);
        assert_eq!(text.matches("h25v25").count(), 35);
        let of = |square_m: f64| paper(&Board::new(9, 6, square_m).unwrap());
        assert_eq!([of(0.025), of(0.03), of(0.2)], [Some("A4"), Some("A3"), None]);
        let grid = svg(&Board::april_grid((6, 4), 0.03, 0.3, 2).unwrap());
        assert!(grid.contains("--pattern aprilgrid --board 6x4 --square-mm 30 --tag-spacing 0.3"), "{grid}");
    }
}
