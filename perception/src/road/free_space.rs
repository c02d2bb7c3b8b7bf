//! Free space ahead: for each group of columns, the distance to the nearest obstacle.

use crate::region::Region;

/// Image columns that share one distance.
pub const COLUMNS: usize = 8;

/// Free distance by column group; memory is allocated once.
#[derive(Debug)]
pub struct FreeSpace {
    free_m: Vec<f32>,
}

impl FreeSpace {
    /// Free space of images of `width` px; all distances are 0.
    pub fn new(width: usize) -> Self {
        Self { free_m: vec![0.0; width.div_ceil(COLUMNS)] }
    }

    /// Free distance ahead in metres for each group of [`COLUMNS`] columns, from the left: up to the nearest
    /// region or, without one, to the far end of the visible road. All values are 0 when no road is visible.
    pub fn free_m(&self) -> &[f32] {
        &self.free_m
    }

    /// Sets all distances to 0; called when no road is visible.
    pub fn clear(&mut self) {
        self.free_m.fill(0.0);
    }

    /// Computes the free space of a frame from its regions and the distance up to which its road is visible.
    pub fn update<'a>(&mut self, regions: impl Iterator<Item = &'a Region>, visible_m: f64) {
        self.free_m.fill(visible_m as f32);
        for region in regions {
            let (from, to) = (region.bounds.x as usize, (region.bounds.x + region.bounds.width) as usize);
            let end = to.div_ceil(COLUMNS).min(self.free_m.len());
            for free in &mut self.free_m[(from / COLUMNS).min(end)..end] {
                *free = free.min(region.distance_m as f32);
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::region::PixelBox;

    #[test]
    fn the_nearest_region_limits_the_free_distance() {
        let region = |x, width, distance_m| Region {
            bounds: PixelBox { x, y: 100, width, height: 40 },
            disparity_px: 100.0 / distance_m,
            disparity_sigma_px: 0.1,
            distance_m,
            lateral_m: 0.0,
            width_m: 1.0,
            height_m: 1.0,
            inset_m: [0.0; 2],
            pixels: 500,
            confidence: 0.9,
            evidence: 4.0,
        };
        let mut free = FreeSpace::new(60);
        assert_eq!(free.free_m(), [0.0; 8]);
        free.update([region(17, 15, 12.0), region(8, 12, 20.0), region(56, 20, 9.0)].iter(), 45.0);
        assert_eq!(free.free_m(), [45.0, 20.0, 12.0, 12.0, 45.0, 45.0, 45.0, 9.0]);
        free.clear();
        assert_eq!(free.free_m(), [0.0; 8]);
    }
}
