//! Free space and boundaries as a record.

use messages::space::{
    BoundaryPointRecord, BoundaryRecord, MAX_BOUNDARIES, MAX_POINTS, MAX_SECTORS, SectorRecord, SpaceRecord,
};
use perception::free_space::boundary::{self, Boundary, Side};
use perception::free_space::ground_grid;
use perception::free_space::sectors::{FreeEnd, FreeSector};

// The record holds all that is found.
const _: () = assert!(ground_grid::MAX_SECTORS == MAX_SECTORS);
const _: () = assert!(boundary::MAX_BOUNDARIES == MAX_BOUNDARIES && boundary::MAX_POINTS == MAX_POINTS);

/// The record of the free space and the boundaries of a frame.
pub fn space_record(free: &[FreeSector], boundaries: &[Boundary]) -> SpaceRecord {
    let first = free.first().copied().unwrap_or_default();
    let mut record = SpaceRecord {
        sectors: free.len().min(MAX_SECTORS) as u32,
        boundaries: boundaries.len().min(MAX_BOUNDARIES) as u32,
        left_slope: first.left_slope as f32,
        slope_step: (first.right_slope - first.left_slope) as f32,
        ..SpaceRecord::default()
    };
    for (to, sector) in record.free.iter_mut().zip(free) {
        *to = SectorRecord {
            near_m: sector.near_m as f32,
            far_m: sector.far_m as f32,
            end: end_index(sector.end),
        };
    }
    for (to, boundary) in record.lines.iter_mut().zip(boundaries) {
        *to = boundary_record(boundary);
    }
    record
}

fn boundary_record(boundary: &Boundary) -> BoundaryRecord {
    let mut record = BoundaryRecord {
        id: boundary.id,
        side: side_index(boundary.side),
        count: boundary.points().len() as u32,
        ..BoundaryRecord::default()
    };
    for (to, point) in record.points.iter_mut().zip(boundary.points()) {
        *to = BoundaryPointRecord {
            lateral_m: point.lateral_m as f32,
            distance_m: point.distance_m as f32,
            height_m: point.height_m as f32,
            sigma_m: point.sigma_m as f32,
        };
    }
    record
}

/// Index into [`messages::space::ENDS`].
fn end_index(end: FreeEnd) -> u32 {
    match end {
        FreeEnd::Unknown => 0,
        FreeEnd::Obstacle => 1,
        FreeEnd::Boundary => 2,
        FreeEnd::Edge => 3,
    }
}

/// Index into [`messages::space::SIDES`].
fn side_index(side: Side) -> u32 {
    match side {
        Side::Left => 0,
        Side::Right => 1,
        Side::Across => 2,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use messages::space::{ENDS, SIDES};

    #[test]
    fn the_names_of_the_messages_are_those_of_the_algorithms() {
        let ends = [FreeEnd::Unknown, FreeEnd::Obstacle, FreeEnd::Boundary, FreeEnd::Edge];
        let sectors =
            ends.map(|end| FreeSector { left_slope: -0.5, right_slope: -0.49, near_m: 4.0, far_m: 9.0, end });
        let record = space_record(&sectors, &[Boundary::default()]);
        for (sector, name) in record.free().iter().zip(["unknown", "obstacle", "boundary", "edge"]) {
            assert_eq!((sector.far_m, ENDS[sector.end as usize]), (9.0, name));
        }
        let sides = [Side::Left, Side::Right, Side::Across].map(|side| SIDES[side_index(side) as usize]);
        assert_eq!(sides, ["left", "right", "across"]);
        assert_eq!(record.lines().len(), 1);
        assert!((record.slope_step - 0.01).abs() < 1e-6);
    }
}
