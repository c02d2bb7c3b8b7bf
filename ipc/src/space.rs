//! Free space and boundaries of a frame, as messages carry them.

use crate::range::{ANY_U32, Each, MAX_METRES, Nested, PADDING, Within, ranges, within};
use bytemuck::{Pod, Zeroable};

/// Maximum number of sectors of the free space.
pub const MAX_SECTORS: usize = 128;

/// Maximum number of boundaries.
pub const MAX_BOUNDARIES: usize = 8;

/// Maximum number of points of a boundary.
pub const MAX_POINTS: usize = 24;

/// Why free space ends, by [`SectorRecord::end`].
pub const ENDS: [&str; 4] = ["unknown", "obstacle", "boundary", "edge"];

/// Where a boundary stands, by [`BoundaryRecord::side`].
pub const SIDES: [&str; 3] = ["left", "right", "across"];

/// Free ground in one direction.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct SectorRecord {
    /// Distance along z from which the ground is known to be free, in metres. What is nearer is not seen.
    pub near_m: f32,
    /// Distance along z up to which it is known to be free, in metres; 0 if nothing is.
    pub far_m: f32,
    /// Why it ends there: an index into [`ENDS`].
    pub end: u32,
}

/// A point at the foot of a boundary.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BoundaryPointRecord {
    /// Lateral position in metres; positive to the right of the camera's axis.
    pub lateral_m: f32,
    /// Distance along z, in metres.
    pub distance_m: f32,
    /// Height above the road, in metres; at most the largest height of an obstacle.
    pub height_m: f32,
    /// Standard deviation of the position across the boundary, in metres.
    pub sigma_m: f32,
}

/// A boundary: a wall, a hedge, a fence, a guard rail, the fronts of houses.
#[repr(C)]
#[derive(Clone, Copy, Debug, Default, PartialEq, Pod, Zeroable)]
pub struct BoundaryRecord {
    /// Number that it keeps as long as it is seen.
    pub id: u32,
    /// Where it stands: an index into [`SIDES`].
    pub side: u32,
    /// Number of points that are used, 0 to [`MAX_POINTS`].
    pub count: u32,
    /// Padding; 0.
    pub padding: u32,
    /// The points, from left to right as the camera sees them; 0 beyond the last one.
    pub points: [BoundaryPointRecord; MAX_POINTS],
}

/// Free space and boundaries. Sector i lies between the directions `left_slope + i · slope_step` and the next one, in
/// metres to the right a metre ahead.
#[repr(C)]
#[derive(Clone, Copy, Debug, PartialEq, Pod, Zeroable)]
pub struct SpaceRecord {
    /// Number of sectors that are used, 0 to [`MAX_SECTORS`].
    pub sectors: u32,
    /// Number of boundaries that are used, 0 to [`MAX_BOUNDARIES`].
    pub boundaries: u32,
    /// Left side of the first sector, in metres to the right a metre ahead.
    pub left_slope: f32,
    /// Width of a sector, in metres a metre ahead.
    pub slope_step: f32,
    /// The sectors, from left to right.
    pub free: [SectorRecord; MAX_SECTORS],
    /// The boundaries, nearest first.
    pub lines: [BoundaryRecord; MAX_BOUNDARIES],
}

/// Lengths.
const LENGTH_M: Within<f32> = within(0.0, MAX_METRES as f32);
/// Largest slope of a ray: the widest image with the shortest focal length that a rig may have, and the largest offset of
/// its principal point.
const MAX_SLOPE: f32 = 20_000.0;

ranges! {
    SectorRecord as "space: sector" {
        near_m: LENGTH_M,
        far_m: LENGTH_M,
        end: within(0, ENDS.len() as u32 - 1),
    }
}

ranges! {
    BoundaryPointRecord as "space: point of a boundary" {
        lateral_m: within(-MAX_METRES as f32, MAX_METRES as f32),
        distance_m: LENGTH_M,
        height_m: LENGTH_M,
        sigma_m: LENGTH_M,
    }
}

ranges! {
    BoundaryRecord as "space: boundary" {
        id: ANY_U32,
        side: within(0, SIDES.len() as u32 - 1),
        count: within(0, MAX_POINTS as u32),
        padding: PADDING,
        points: Each(Nested),
    }
}

ranges! {
    SpaceRecord as "space" {
        sectors: within(0, MAX_SECTORS as u32),
        boundaries: within(0, MAX_BOUNDARIES as u32),
        left_slope: within(-MAX_SLOPE, MAX_SLOPE),
        slope_step: within(0.0, MAX_SLOPE),
        free: Each(Nested),
        lines: Each(Nested),
    }
}

impl Default for SpaceRecord {
    fn default() -> Self {
        Self::zeroed()
    }
}

impl BoundaryRecord {
    /// The points.
    pub fn points(&self) -> &[BoundaryPointRecord] {
        &self.points[..(self.count as usize).min(MAX_POINTS)]
    }
}

impl SpaceRecord {
    /// The sectors.
    pub fn free(&self) -> &[SectorRecord] {
        &self.free[..(self.sectors as usize).min(MAX_SECTORS)]
    }

    /// The boundaries.
    pub fn lines(&self) -> &[BoundaryRecord] {
        &self.lines[..(self.boundaries as usize).min(MAX_BOUNDARIES)]
    }

    /// How far a lane of this half width straight ahead is known to be free, in metres: 0 if nothing is known in a direction
    /// that the lane has where it is seen; `None` if no ground is free at all.
    pub fn free_ahead_m(&self, half_width_m: f64) -> Option<f64> {
        let free = self.free();
        let nearest_m =
            free.iter().filter(|s| s.far_m > 0.0).map(|s| f64::from(s.near_m)).reduce(f64::min)?;
        let slope = |i: usize| f64::from(self.left_slope) + f64::from(self.slope_step) * i as f64;
        let in_lane = |&(i, sector): &(usize, &SectorRecord)| {
            // A sector enters the lane at its near end.
            let lane = half_width_m / nearest_m.max(f64::from(sector.near_m)).max(1.0);
            slope(i) < lane && slope(i + 1) > -lane
        };
        // What ends outside of the lane does not bound it.
        let bounds = |&(i, sector): &(usize, &SectorRecord)| {
            let far_m = f64::from(sector.far_m);
            far_m == 0.0 || (slope(i) * far_m < half_width_m && slope(i + 1) * far_m > -half_width_m)
        };
        let sectors = free.iter().enumerate().filter(in_lane).filter(bounds);
        sectors.map(|(_, sector)| f64::from(sector.far_m)).reduce(f64::min)
    }

    /// The free space as polygons on the ground: each a list of corners, right and ahead of the camera in metres, along the
    /// far side from left to right and back along the near side. Between two sectors the smaller range counts, so that the
    /// polygons contain nothing that is not free.
    pub fn polygons(&self) -> Vec<Vec<[f64; 2]>> {
        let free = self.free();
        let slope = |i: usize| f64::from(self.left_slope) + f64::from(self.slope_step) * i as f64;
        let is_free = |i: usize| free[i].far_m > free[i].near_m;
        let mut all = Vec::new();
        let mut from = 0;
        while from < free.len() {
            if !is_free(from) {
                from += 1;
                continue;
            }
            let end = (from..free.len()).find(|&i| !is_free(i)).unwrap_or(free.len());
            // The sectors on both sides of a corner.
            let sides = |i: usize| &free[i.max(from + 1) - 1..(i + 1).min(end)];
            let corner = |i: usize, distance_m: f64| [slope(i) * distance_m, distance_m];
            let far_m = |i: usize| sides(i).iter().map(|s| f64::from(s.far_m)).fold(f64::INFINITY, f64::min);
            let near_m = |i: usize| sides(i).iter().map(|s| f64::from(s.near_m)).fold(0.0, f64::max);
            let far = (from..=end).map(|i| corner(i, far_m(i)));
            let near = (from..=end).rev().map(|i| corner(i, near_m(i).min(far_m(i))));
            all.push(far.chain(near).collect());
            from = end;
        }
        all
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::range::Ranged;

    fn record() -> SpaceRecord {
        let mut record =
            SpaceRecord { sectors: 5, left_slope: -0.5, slope_step: 0.2, ..SpaceRecord::default() };
        for (sector, far_m) in record.free.iter_mut().zip([10.0, 20.0, 0.0, 30.0, 30.0]) {
            (sector.near_m, sector.far_m, sector.end) = (if far_m > 0.0 { 4.0 } else { 0.0 }, far_m, 1);
        }
        record
    }

    #[test]
    fn polygons_lie_within_the_sectors() {
        let polygons = record().polygons();
        assert_eq!(polygons.len(), 2);
        let [left, right] = [&polygons[0], &polygons[1]];
        assert_eq!((left.len(), right.len()), (6, 6));
        let distances = |polygon: &[[f64; 2]]| polygon.iter().map(|[_, z]| *z).collect::<Vec<_>>();
        assert_eq!(distances(left), [10.0, 10.0, 20.0, 4.0, 4.0, 4.0]);
        assert!((left[2][0] - 20.0 * -0.1).abs() < 1e-5, "{left:?}");
        assert!((right[0][0] - 30.0 * 0.1).abs() < 1e-5 && (right[2][0] - 15.0).abs() < 1e-4, "{right:?}");
        assert!(SpaceRecord::default().polygons().is_empty());
    }

    #[test]
    fn the_lane_ahead_is_as_free_as_its_nearest_bound() {
        let mut record =
            SpaceRecord { sectors: 40, left_slope: -0.4, slope_step: 0.02, ..SpaceRecord::default() };
        assert_eq!(record.free_ahead_m(1.0), None);
        for sector in &mut record.free[..40] {
            (sector.near_m, sector.far_m) = (4.0, 30.0);
        }
        assert_eq!(record.free_ahead_m(1.0), Some(30.0));
        // 0.11 to the right at 15 m: 1.65 m beside the axis, outside of the lane; at 8 m inside.
        record.free[25].far_m = 15.0;
        assert_eq!(record.free_ahead_m(1.0), Some(30.0));
        record.free[25].far_m = 8.0;
        assert_eq!(record.free_ahead_m(1.0), Some(8.0));
        (record.free[20].near_m, record.free[20].far_m) = (0.0, 0.0);
        assert_eq!(record.free_ahead_m(1.0), Some(0.0), "unknown is not free");
    }

    #[test]
    fn numbers_out_of_range_are_refused_and_counts_stay_in_bounds() {
        let good = record();
        assert_eq!(good.check(), Ok(()));
        for (field, wrong) in good.invalid() {
            assert!(wrong.check().is_err(), "{field}");
        }
        let wrong = SpaceRecord { sectors: u32::MAX, boundaries: u32::MAX, ..good };
        assert_eq!((wrong.free().len(), wrong.lines().len()), (MAX_SECTORS, MAX_BOUNDARIES));
        let line = BoundaryRecord { count: 99, ..BoundaryRecord::default() };
        assert_eq!(line.points().len(), MAX_POINTS);
    }
}
