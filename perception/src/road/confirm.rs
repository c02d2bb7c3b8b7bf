//! Which regions are believed: those that stand out in one frame, and weaker ones that come back.
//!
//! A small or distant thing rises little above the noise of one frame. Noise does not come back at
//! the same place, things do: a weak region counts once it was seen in three frames, none too long
//! ago.

use super::regions::{PixelBox, Region};

/// Sightings that make a weak region believed.
const SIGHTINGS: u8 = 3;
/// Sightings beyond this are not counted, so that what vanishes is soon doubted.
const MOST_SIGHTINGS: u8 = 5;
/// The most candidates that are remembered.
const CAPACITY: usize = 256;

/// Something that was seen, or may have been.
#[derive(Clone, Copy, Debug)]
struct Candidate {
    bounds: PixelBox,
    disparity_px: f64,
    sightings: u8,
    seen_now: bool,
}

/// Remembers the regions of the last frames, with memory allocated once.
#[derive(Debug)]
pub struct Confirmation {
    candidates: Vec<Candidate>,
}

impl Default for Confirmation {
    fn default() -> Self {
        Self { candidates: Vec::with_capacity(2 * CAPACITY) }
    }
}

impl Confirmation {
    /// Forgets everything.
    pub fn clear(&mut self) {
        self.candidates.clear();
    }

    /// Takes the regions of a frame and leaves those that are believed: `stands_out` says which need no
    /// confirmation.
    pub fn filter(&mut self, regions: &mut Vec<Region>, stands_out: impl Fn(&Region) -> bool) {
        self.candidates.iter_mut().for_each(|candidate| candidate.seen_now = false);
        let known = self.candidates.len();
        regions.retain(|region| {
            let strong = stands_out(region);
            let before = self.candidates[..known]
                .iter_mut()
                .filter(|candidate| !candidate.seen_now && comes_back(candidate, region))
                .max_by(|a, b| {
                    a.sightings.cmp(&b.sightings).then(nearness(a, region).total_cmp(&nearness(b, region)))
                });
            let gain = if strong { 2 } else { 1 };
            match before {
                Some(candidate) => {
                    candidate.sightings = (candidate.sightings + gain).min(MOST_SIGHTINGS);
                    candidate.seen_now = true;
                    (candidate.bounds, candidate.disparity_px) = (region.bounds, region.disparity_px);
                    strong || candidate.sightings >= SIGHTINGS
                }
                None => {
                    if self.candidates.len() < 2 * CAPACITY {
                        self.candidates.push(Candidate {
                            bounds: region.bounds,
                            disparity_px: region.disparity_px,
                            sightings: gain,
                            seen_now: true,
                        });
                    }
                    strong
                }
            }
        });
        self.candidates.retain_mut(|candidate| {
            if !candidate.seen_now {
                candidate.sightings -= 1;
            }
            candidate.sightings > 0
        });
        self.candidates.truncate(CAPACITY);
    }
}

/// How near a region is to where a candidate was: 0 and less, the more the nearer.
fn nearness(candidate: &Candidate, region: &Region) -> f64 {
    let middle = |b: &PixelBox| f64::from(2 * b.x + b.width);
    -(middle(&candidate.bounds) - middle(&region.bounds)).abs()
        - 20.0 * (candidate.disparity_px - region.disparity_px).abs()
}

/// Whether a region may be what a candidate was, a frame or so ago.
fn comes_back(candidate: &Candidate, region: &Region) -> bool {
    let depth = region.disparity_px - candidate.disparity_px;
    // Vehicles close in faster than they fall back.
    let reach = 0.4 + 0.06 * candidate.disparity_px;
    if !(-reach..=2.5 * reach).contains(&depth) {
        return false;
    }
    let (a, b) = (&candidate.bounds, &region.bounds);
    let apart = |a: u32, al: u32, b: u32, bl: u32| i64::from(a.max(b)) - i64::from((a + al).min(b + bl));
    let slack = 4 + (2.0 * region.disparity_px) as i64 / 2;
    apart(a.x, a.width, b.x, b.width) <= slack && apart(a.y, a.height, b.y, b.height) <= 2
}

#[cfg(test)]
mod tests {
    use super::*;

    fn region(x: u32, disparity_px: f64) -> Region {
        Region {
            bounds: PixelBox { x, y: 200, width: 16, height: 20 },
            disparity_px,
            disparity_sigma_px: 0.1,
            distance_m: 100.0 / disparity_px,
            lateral_m: 0.0,
            width_m: 0.4,
            height_m: 0.5,
            pixels: 100,
        }
    }

    /// How many are believed of each frame's regions.
    fn believed(frames: &[&[Region]], strong: bool) -> Vec<usize> {
        let mut confirmation = Confirmation::default();
        frames
            .iter()
            .map(|frame| {
                let mut regions = frame.to_vec();
                confirmation.filter(&mut regions, |_| strong);
                regions.len()
            })
            .collect()
    }

    #[test]
    fn a_weak_region_counts_from_its_third_sighting() {
        let seen = [region(300, 5.0)];
        assert_eq!(believed(&[&seen, &seen, &seen, &seen], false), [0, 0, 1, 1]);
        assert_eq!(believed(&[&seen], true), [1], "a strong one at once");
        // One that was believed may be missed once; one that comes and goes is not.
        assert_eq!(believed(&[&seen, &seen, &seen, &seen, &[], &seen], false), [0, 0, 1, 1, 0, 1]);
        assert_eq!(believed(&[&seen, &[], &seen, &[], &seen, &[]], false), [0; 6]);
    }

    #[test]
    fn noise_elsewhere_confirms_nothing() {
        let frames: Vec<[Region; 1]> = (0..20).map(|i| [region(60 * (i * 7 % 10), 5.0)]).collect();
        let frames: Vec<&[Region]> = frames.iter().map(|f| &f[..]).collect();
        assert!(believed(&frames, false).iter().all(|&n| n == 0));
        let depths: Vec<[Region; 1]> = (0..20).map(|i| [region(300, 3.0 + f64::from(i * 7 % 10))]).collect();
        let depths: Vec<&[Region]> = depths.iter().map(|f| &f[..]).collect();
        assert!(believed(&depths, false).iter().all(|&n| n == 0));
    }

    #[test]
    fn what_comes_nearer_stays_the_same() {
        // 20 m/s at 12.5 frames a second from 20 m on.
        let frames: Vec<[Region; 1]> =
            (0..8).map(|i| [region(300 + i * 2, 105.0 / (20.0 - 1.6 * f64::from(i)))]).collect();
        let frames: Vec<&[Region]> = frames.iter().map(|f| &f[..]).collect();
        assert_eq!(believed(&frames, false), [0, 0, 1, 1, 1, 1, 1, 1]);
    }
}
