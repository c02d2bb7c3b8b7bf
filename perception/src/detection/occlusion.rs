//! Whether something nearer hides what is beyond the sides of a region.
//!
//! Who comes out from behind a wall shows more of himself in each frame: the side that he shows moves as he does, and the middle of
//! what is seen of him half as fast.

use super::stixels::{STRIP_COLUMNS, Stixel};
use crate::region::PixelBox;

/// What hides a side is at most this many strips beside it.
const MAX_GAP_STRIPS: usize = 5;
/// To the left of what is nearer the right camera misses as many columns as both disparities differ by; it is looked for in this many
/// strips.
const MAX_MISSED_STRIPS: usize = 8;

/// Whether stixels that are nearer than `disparity_px`, by more than `tolerance_px`, border on the left and the right side of a box in at
/// least half of its height. `strips`: how many there are, and the stixels of each.
pub(super) fn hidden_sides<'a>(
    strips: (usize, impl Fn(usize) -> &'a [Stixel]),
    bounds: &PixelBox,
    disparity_px: f32,
    tolerance_px: f32,
) -> [bool; 2] {
    let (top, bottom) = (bounds.y, bounds.y + bounds.height);
    let hides = |stixel: &Stixel, missed_px: f32| {
        let nearer_px = stixel.disparity_px - disparity_px;
        let shared = bottom.min(u32::from(stixel.bottom) + 1).saturating_sub(top.max(stixel.top.into()));
        nearer_px > tolerance_px.max(missed_px) && 2 * shared >= bounds.height
    };
    let is_hidden_by =
        |strip: usize, missed_px: f32| strips.1(strip).iter().any(|stixel| hides(stixel, missed_px));
    let first = (bounds.x as usize / STRIP_COLUMNS).min(strips.0);
    let end = ((bounds.x + bounds.width) as usize).div_ceil(STRIP_COLUMNS);
    let last = (end + MAX_GAP_STRIPS + MAX_MISSED_STRIPS).min(strips.0);
    let missed_px = |strip: usize| ((strip - end).saturating_sub(MAX_GAP_STRIPS) * STRIP_COLUMNS) as f32;
    [
        (first.saturating_sub(MAX_GAP_STRIPS)..first).any(|strip| is_hidden_by(strip, 0.0)),
        (end..last).any(|strip| is_hidden_by(strip, missed_px(strip))),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Which sides of a box in columns 60 to 80 at a disparity of 8 px are hidden, beside something with another disparity in these strips
    /// and rows.
    fn hidden(beside: std::ops::Range<u32>, disparity_px: f32, rows: [u16; 2]) -> [bool; 2] {
        let stixel = |strip: u32, disparity_px: f32, [top, bottom]: [u16; 2]| Stixel {
            strip,
            top,
            bottom,
            rows: bottom + 1 - top,
            disparity_px,
            ..Stixel::default()
        };
        let own = (15..20).map(|strip| stixel(strip, 8.0, [100, 139]));
        let all: Vec<Stixel> = own.chain(beside.map(|strip| stixel(strip, disparity_px, rows))).collect();
        let of = |strip: usize| {
            let from = all.iter().position(|s| s.strip as usize == strip);
            from.map_or(&all[..0], |from| &all[from..from + 1])
        };
        hidden_sides((40, of), &PixelBox { x: 60, y: 100, width: 20, height: 40 }, 8.0, 0.5)
    }

    #[test]
    fn what_is_nearer_and_beside_it_hides_a_side() {
        let rows = [80, 145];
        assert_eq!(hidden(20..30, 12.0, rows), [false, true]);
        assert_eq!(hidden(8..15, 12.0, rows), [true, false]);
        // The right camera misses twelve columns to the left of what is nearer by as much.
        assert_eq!(hidden(27..35, 20.0, rows), [false, true]);
        assert_eq!(hidden(27..35, 9.0, rows), [false; 2], "too far beside it");
        assert_eq!(hidden(0..9, 20.0, rows), [false; 2], "too far beside it, and nothing is missed there");
        assert_eq!(hidden(20..30, 6.0, rows), [false; 2], "behind it");
        assert_eq!(hidden(20..30, 8.3, rows), [false; 2], "as far away");
        assert_eq!(hidden(20..30, 12.0, [125, 145]), [false; 2], "a kerb before its foot");
    }
}
