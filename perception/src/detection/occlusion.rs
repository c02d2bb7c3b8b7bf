//! Whether something nearer hides what is beyond the sides of a region.
//!
//! Who comes out from behind a wall shows more of himself in each frame: the side that he shows moves as he does, and the middle of
//! what is seen of him half as fast. Of a hedge that leaves the picture on one side, the other side is where the region was divided: it
//! is no end, either, and does not move as the hedge does.

use super::stixels::{STRIP_COLUMNS, Stixel};
use crate::region::PixelBox;

/// What hides a side is at most this many strips beside it.
const MAX_GAP_STRIPS: usize = 5;
/// To the left of what is nearer the right camera misses as many columns as both disparities differ by; it is looked for in this many
/// strips.
const MAX_MISSED_STRIPS: usize = 8;
/// The border of the picture cuts what is at most so many strips beside it,
const BORDER_STRIPS: usize = 2;
/// and its surface goes on if it does in one of so many strips beside its other side.
const NEXT_STRIPS: usize = 2;

/// Whether stixels that are nearer than `disparity_px`, by more than `tolerance_px`, border on the left and the right side of a box in at
/// least half of its height. `strips`: how many there are, and the stixels of each.
pub(super) fn hidden_sides<'a>(
    strips: (usize, impl Fn(usize) -> &'a [Stixel]),
    bounds: &PixelBox,
    disparity_px: f32,
    tolerance_px: f32,
) -> [bool; 2] {
    let hides = |stixel: &Stixel, missed_px: f32| {
        stixel.disparity_px - disparity_px > tolerance_px.max(missed_px) && shares(stixel, bounds)
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

/// Whether the surface of a box goes on beyond its left and its right side, while the picture cuts the other one: stixels on both sides
/// of that side differ by at most `tolerance_px`. Other arguments as for [`hidden_sides`].
pub(super) fn continued_sides<'a>(
    (count, strips): (usize, impl Fn(usize) -> &'a [Stixel]),
    bounds: &PixelBox,
    disparity_px: f32,
    tolerance_px: f32,
) -> [bool; 2] {
    let first = (bounds.x as usize / STRIP_COLUMNS).min(count);
    let end = ((bounds.x + bounds.width) as usize).div_ceil(STRIP_COLUMNS).min(count);
    // To the left the right camera misses as many columns as the disparity.
    let is_cut = [
        first * STRIP_COLUMNS <= disparity_px.max(0.0) as usize + BORDER_STRIPS * STRIP_COLUMNS,
        end + BORDER_STRIPS >= count,
    ];
    let of = |strip: usize| strips(strip).iter().filter(|stixel| shares(stixel, bounds));
    let goes_on = |inside: usize, mut beside: std::ops::Range<usize>| {
        beside.any(|strip| {
            let is_near =
                |a: &Stixel| of(strip).any(|b| (a.disparity_px - b.disparity_px).abs() <= tolerance_px);
            of(inside).any(is_near)
        })
    };
    if first >= end {
        return [false; 2];
    }
    [
        is_cut[1] && goes_on(first, first.saturating_sub(NEXT_STRIPS)..first),
        is_cut[0] && goes_on(end - 1, end..(end + NEXT_STRIPS).min(count)),
    ]
}

/// Whether a stixel stands beside a box in at least half of its height.
fn shares(stixel: &Stixel, bounds: &PixelBox) -> bool {
    let (top, bottom) = (bounds.y, bounds.y + bounds.height);
    let shared = bottom.min(u32::from(stixel.bottom) + 1).saturating_sub(top.max(stixel.top.into()));
    2 * shared >= bounds.height
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

    /// Which sides of a box in columns 8 to 80 go on, if 200 columns have stixels as high whose disparity falls by `slope_px` a strip, in
    /// a picture of `columns`; beyond column 80 it is `step_px` less.
    fn continued(x: u32, columns: usize, slope_px: f32, step_px: f32) -> [bool; 2] {
        let disparity_px =
            |strip: u32| 8.0 - slope_px * strip as f32 - if strip >= 20 { step_px } else { 0.0 };
        let stixel = |strip| Stixel {
            strip,
            top: 100,
            bottom: 139,
            rows: 40,
            disparity_px: disparity_px(strip),
            ..Stixel::default()
        };
        let all: Vec<Stixel> = (0..columns as u32 / 4).map(stixel).collect();
        let of = |strip: usize| &all[strip..strip + 1];
        let bounds = PixelBox { x, y: 100, width: 80 - x, height: 40 };
        continued_sides((columns / 4, of), &bounds, 8.0, 0.3)
    }

    #[test]
    fn what_the_picture_cuts_goes_on_where_the_surface_does() {
        assert_eq!(continued(8, 200, 0.1, 0.0), [false, true], "a hedge that was divided");
        assert_eq!(continued(8, 200, 0.1, 0.5), [false; 2], "it ends");
        assert_eq!(continued(40, 200, 0.1, 0.0), [false; 2], "the picture cuts neither side");
        assert_eq!(continued(40, 80, 0.1, 0.0), [true, false], "it leaves the picture to the right");
    }
}
