//! Curves of one frame: stixels that continue each other from strip to strip.
//!
//! A point on the ground is seen along a ray with `slope` (metres right a metre ahead) at the inverse distance `w`. For the
//! points of a line at the distance ρ from the camera with the normal (a, b), w = (a·slope + b) / ρ: linear, with the same
//! error everywhere, because disparity is proportional to w. An error or a roughness of r metres across the line is
//! w·r/ρ, a turn of its direction by an angle changes the rate of w by angle / (w·ρ²).

use super::boundary::{Boundary, BoundaryPoint, MAX_POINTS};
use super::limits::{
    BENDING_RAD, GATE_SIGMAS, HEIGHT_STEP_M, LONGEST_VEHICLE_M, LORRY_GAP_M, LOW_HEIGHT_M, MAX_GAP_M,
    MAX_HIDDEN_M, MIN_LENGTH_M, MIN_PART_M, RAISED_M, ROUGHNESS_M, STEADY_SHARE, STIXEL_SIGMA_PX,
    TALL_HEIGHT_M, TALL_LENGTH_M, TALL_SHARE,
};
use crate::detection::stixel_use::StixelUse;
use crate::detection::stixels::{Stixel, Stixels};
use crate::rig::Rig;

/// A stixel that starts higher above the road than this does not stand on it, in metres: below a guard rail there is
/// half a metre of air.
const MAX_FOOT_M: f32 = 0.8;

/// Smallest distance of the camera from the line of a boundary, in metres: half a vehicle.
const MIN_LINE_M: f64 = 0.7;

/// Standard deviation of the rate of the inverse distance before it is known, in 1/m: a wall 1 m beside the camera.
const RATE_PER_M: f64 = 1.0;

/// Maximum number of curves of a frame.
const MAX_CURVES: usize = 16;

/// A stixel as a measurement along its ray.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RayStixel {
    /// Inverse distance, in 1/m.
    pub inverse_m: f64,
    /// Its standard deviation, in 1/m.
    pub sigma: f64,
}

impl RayStixel {
    /// The measurement of a stixel in a frame with this noise of disparity (px).
    pub fn new(stixel: &Stixel, rig: &Rig, noise_px: f64) -> Self {
        let px_at_1_m = rig.disparity_px(1.0);
        Self {
            inverse_m: f64::from(stixel.disparity_px).max(0.05) / px_at_1_m,
            sigma: STIXEL_SIGMA_PX.hypot(noise_px) / px_at_1_m,
        }
    }
}

/// A stixel of a curve.
#[derive(Clone, Copy, Debug)]
struct Member {
    slope: f64,
    inverse_m: f64,
    height_m: f64,
    /// Whether it goes on higher than any vehicle; `None` where nothing tells.
    is_tall: Option<bool>,
    /// Length from the member before it, in metres; 0 where something is hidden between them.
    seen_m: f64,
}

/// Inverse distance along a curve, and its rate over the slope of the ray, with their covariance.
#[derive(Clone, Copy, Debug)]
struct Follower {
    slope: f64,
    inverse_m: f64,
    rate: f64,
    variance: [f64; 3],
}

impl Follower {
    fn point(&self) -> [f64; 2] {
        [self.slope / self.inverse_m, 1.0 / self.inverse_m]
    }

    /// Distance of the camera from the line, in metres.
    fn line_m(&self) -> f64 {
        1.0 / self.rate.hypot(self.inverse_m - self.rate * self.slope).max(1e-6)
    }

    /// Goes on to the next strip; returns the length of the step in metres.
    fn advance(&mut self, slope: f64) -> f64 {
        let before = self.point();
        let by = slope - self.slope;
        let [v, c, r] = self.variance;
        (self.slope, self.inverse_m) = (slope, self.inverse_m + self.rate * by);
        let after = self.point();
        let length_m = (after[0] - before[0]).hypot(after[1] - before[1]);
        let turn = BENDING_RAD / (self.inverse_m.abs().max(1e-3) * self.line_m().powi(2));
        self.variance = [v + 2.0 * c * by + r * by * by, c + r * by, r + turn * turn * length_m];
        length_m
    }

    /// Variance of a measurement about the curve.
    fn spread(&self, sigma: f64) -> f64 {
        let rough = self.inverse_m * ROUGHNESS_M / self.line_m();
        sigma * sigma + rough * rough
    }

    fn correct(&mut self, inverse_m: f64, spread: f64) {
        let [v, c, r] = self.variance;
        let total = v + spread;
        let gain = [v / total, c / total];
        let innovation = inverse_m - self.inverse_m;
        self.inverse_m += gain[0] * innovation;
        self.rate += gain[1] * innovation;
        self.variance = [v * (1.0 - gain[0]), c * (1.0 - gain[0]), r - gain[1] * c];
    }
}

/// Finds the curves of a frame; memory is allocated once.
#[derive(Debug)]
pub struct CurveFinder {
    rig: Rig,
    visited: Vec<bool>,
    members: Vec<Member>,
    /// Those of a curve that is divided into parts.
    whole: Vec<Member>,
    /// Heights with the length that has them.
    heights: Vec<(f64, f64)>,
    curves: Vec<Boundary>,
    /// Curves that are too short to be boundaries by themselves.
    parts: Vec<Boundary>,
}

impl CurveFinder {
    /// A workspace.
    pub fn new(rig: Rig, stixels: &Stixels) -> Self {
        Self {
            rig,
            visited: Vec::with_capacity(stixels.capacity()),
            members: Vec::with_capacity(stixels.strips()),
            whole: Vec::with_capacity(stixels.strips()),
            heights: Vec::with_capacity(stixels.strips()),
            curves: Vec::with_capacity(MAX_CURVES),
            parts: Vec::with_capacity(MAX_CURVES),
        }
    }

    /// The curves in the free stixels of a frame with this noise of disparity (px): those that are boundaries, and parts that are too
    /// short to tell.
    pub fn find(&mut self, stixels: &Stixels, uses: &[StixelUse], noise_px: f64) -> [&[Boundary]; 2] {
        self.visited.clear();
        self.visited.extend(uses.iter().map(|stixel_use| !stixel_use.is_free()));
        self.visited.resize(stixels.list().len(), false);
        self.curves.clear();
        self.parts.clear();
        for seed in 0..stixels.list().len() {
            if self.visited[seed]
                || stixels.list()[seed].low_m > MAX_FOOT_M
                || self.curves.len() == MAX_CURVES
            {
                continue;
            }
            self.follow(stixels, seed, noise_px);
            self.trim_start(noise_px);
            if self.is_boundary() {
                let curve = self.curve();
                self.curves.push(curve);
            } else {
                self.add_parts();
            }
        }
        [&self.curves, &self.parts]
    }

    fn slope(&self, strip: usize) -> f64 {
        (Stixels::column(strip) - self.rig.cx_px) / self.rig.focal_px
    }

    /// Collects the members of the curve that starts at a stixel.
    fn follow(&mut self, stixels: &Stixels, seed: usize, noise_px: f64) {
        let list = stixels.list();
        let first = RayStixel::new(&list[seed], &self.rig, noise_px);
        let strip = list[seed].strip as usize;
        let mut at = Follower {
            slope: self.slope(strip),
            inverse_m: first.inverse_m,
            rate: 0.0,
            variance: [first.sigma * first.sigma, 0.0, RATE_PER_M * RATE_PER_M],
        };
        self.members.clear();
        self.add(stixels, seed, at, 0.0, noise_px);
        let (mut gap_m, mut hidden_m, mut since_m, mut missing) = (0.0, 0.0, 0.0, 0);
        for strip in strip + 1..stixels.strips() {
            let step_m = at.advance(self.slope(strip));
            let spread = at.spread(first.sigma);
            let gate = GATE_SIGMAS * (at.variance[0] + spread).sqrt();
            let limit = at.inverse_m * MAX_GAP_M / at.line_m();
            // While the rate is unknown the gate is that of the steepest curve; then no jump across counts.
            let gate =
                if self.members.len() < 4 { gate } else { gate.min(limit.max(GATE_SIGMAS * first.sigma)) };
            if at.inverse_m < 1e-3 || (self.members.len() >= 4 && at.line_m() < MIN_LINE_M) {
                break;
            }
            since_m += step_m;
            let away =
                |i: &usize| (RayStixel::new(&list[*i], &self.rig, noise_px).inverse_m - at.inverse_m).abs();
            let stands = |i: &usize| list[*i].low_m <= MAX_FOOT_M && !self.visited[*i];
            let nearest = stixels.range(strip).filter(stands).min_by(|a, b| away(a).total_cmp(&away(b)));
            match nearest.filter(|i| away(i) <= gate) {
                Some(next) => {
                    let ray = RayStixel::new(&list[next], &self.rig, noise_px);
                    at.correct(ray.inverse_m, spread);
                    self.add(stixels, next, at, if hidden_m > 0.0 { 0.0 } else { since_m }, noise_px);
                    (gap_m, hidden_m, since_m, missing) = (0.0, 0.0, 0.0, 0);
                }
                None => {
                    let is_nearer = |i: usize| {
                        RayStixel::new(&list[i], &self.rig, noise_px).inverse_m > at.inverse_m + gate
                    };
                    if stixels.range(strip).any(is_nearer) {
                        hidden_m += step_m;
                    } else {
                        gap_m += step_m;
                        missing += 1;
                    }
                    if (gap_m > MAX_GAP_M && missing > 1) || hidden_m > MAX_HIDDEN_M {
                        break;
                    }
                }
            }
        }
    }

    /// Drops the first members, as far as the others do not lead back to them: where a curve begins, its direction is not
    /// known yet, and anything is taken.
    fn trim_start(&mut self, noise_px: f64) {
        let Some(last) = self.members.last() else { return };
        let sigma = STIXEL_SIGMA_PX.hypot(noise_px) / self.rig.disparity_px(1.0);
        let mut at = Follower {
            slope: last.slope,
            inverse_m: last.inverse_m,
            rate: 0.0,
            variance: [sigma * sigma, 0.0, RATE_PER_M * RATE_PER_M],
        };
        let leads = |member: &Member| {
            at.advance(member.slope);
            let spread = at.spread(sigma);
            let gate = GATE_SIGMAS * (at.variance[0] + spread).sqrt();
            let is_near = (member.inverse_m - at.inverse_m).abs() <= gate;
            at.correct(member.inverse_m, spread);
            is_near
        };
        let kept = self.members.iter().rev().skip(1).map(leads).take_while(|is_near| *is_near).count() + 1;
        self.members.drain(..self.members.len() - kept);
        if let Some(first) = self.members.first_mut() {
            first.seen_m = 0.0;
        }
    }

    /// Adds a member: its height is that of all stixels of the strip at its distance.
    fn add(&mut self, stixels: &Stixels, index: usize, at: Follower, seen_m: f64, noise_px: f64) {
        let list = stixels.list();
        let own = list[index];
        let tolerance_px = (GATE_SIGMAS * STIXEL_SIGMA_PX.hypot(noise_px)) as f32;
        let mut height_m = own.high_m;
        for i in stixels.range(own.strip as usize) {
            if (list[i].disparity_px - own.disparity_px).abs() <= tolerance_px {
                height_m = height_m.max(list[i].high_m);
                self.visited[i] = true;
            }
        }
        self.visited[index] = true;
        let inverse_m = RayStixel::new(&own, &self.rig, noise_px).inverse_m;
        let is_tall = self.is_tall(stixels, &own, tolerance_px);
        let member = Member { slope: at.slope, inverse_m, height_m: f64::from(height_m), is_tall, seen_m };
        self.members.push(member);
    }

    /// Whether the surface of a stixel goes on up to where no vehicle reaches; `None` if nothing tells: the picture ends before, or
    /// there is no texture.
    fn is_tall(&self, stixels: &Stixels, own: &Stixel, tolerance_px: f32) -> Option<bool> {
        let rows_per_m = f64::from(own.disparity_px) / self.rig.baseline_m;
        let above = (TALL_HEIGHT_M - f64::from(own.high_m)) * rows_per_m;
        let top = usize::from(own.top).checked_sub(above.max(0.0).ceil() as usize)?;
        let rows = &stixels.depths(own.strip as usize)[top..usize::from(own.top)];
        let share = |is: &dyn Fn(f32) -> bool| {
            let count = rows.iter().filter(|depth| **depth > 0 && is(f32::from(**depth) / 256.0)).count();
            count as f64 / rows.len().max(1) as f64
        };
        let is_same = |px: f32| (px - own.disparity_px).abs() <= tolerance_px;
        let is_behind = |px: f32| px < own.disparity_px - tolerance_px;
        if rows.is_empty() || share(&is_same) >= TALL_SHARE {
            return Some(true);
        }
        (share(&is_behind) >= TALL_SHARE).then_some(false)
    }

    /// Whether the collected members are longer than a vehicle, without the gaps between vehicles, and steady.
    fn is_boundary(&mut self) -> bool {
        // Lower is the face of raised ground.
        let is_low = |height_m: f64| (f64::from(RAISED_M.end)..LOW_HEIGHT_M).contains(&height_m);
        self.is_steady(MAX_GAP_M, MIN_LENGTH_M).is_some_and(is_low)
            || self.is_steady(LORRY_GAP_M, LONGEST_VEHICLE_M).is_some_and(|height_m| height_m >= LOW_HEIGHT_M)
            || self.is_high()
    }

    /// Adds the runs of members in which a gap of [`MAX_GAP_M`] would be seen, if they are long and steady enough to be parts of a
    /// boundary.
    fn add_parts(&mut self) {
        let is_resolved = |member: &Member| member.seen_m > 0.0 && member.seen_m <= MAX_GAP_M;
        let all = std::mem::take(&mut self.whole);
        self.whole = std::mem::replace(&mut self.members, all);
        let mut from = 0;
        while from < self.whole.len() && self.parts.len() < MAX_CURVES {
            let run = self.whole[from + 1..].iter().take_while(|member| is_resolved(member)).count() + 1;
            self.members.clear();
            self.members.extend_from_slice(&self.whole[from..from + run]);
            self.members[0].seen_m = 0.0;
            if self.is_steady(MAX_GAP_M, MIN_PART_M).is_some() {
                let curve = self.curve();
                self.parts.push(curve);
            }
            from += run;
        }
    }

    /// Whether what is seen of the members is higher than any vehicle.
    fn is_high(&self) -> bool {
        let mut seen_m = [0.0; 2];
        for member in self.members.iter().filter(|member| member.seen_m <= LORRY_GAP_M) {
            if let Some(is_tall) = member.is_tall {
                seen_m[usize::from(is_tall)] += member.seen_m;
            }
        }
        let [low_m, tall_m] = seen_m;
        tall_m >= TALL_LENGTH_M && tall_m >= STEADY_SHARE * (low_m + tall_m)
    }

    /// The median height of the members, if the part in which a gap of `gap_m` would be seen is longer than `length_m`
    /// and has a steady height.
    fn is_steady(&mut self, gap_m: f64, length_m: f64) -> Option<f64> {
        self.heights.clear();
        let resolved = self.members.iter().filter(|member| member.seen_m > 0.0 && member.seen_m <= gap_m);
        self.heights.extend(resolved.map(|member| (member.height_m, member.seen_m)));
        let resolved_m: f64 = self.heights.iter().map(|(_, length)| length).sum();
        if resolved_m < length_m {
            return None;
        }
        self.heights.sort_unstable_by(|a, b| a.0.total_cmp(&b.0));
        let mut below_m = 0.0;
        let (median, _) = *self.heights.iter().find(|(_, length)| {
            below_m += length;
            below_m >= 0.5 * resolved_m
        })?;
        let steady = self.heights.iter().filter(|(height, _)| (height - median).abs() <= HEIGHT_STEP_M);
        let steady_m: f64 = steady.map(|(_, length)| length).sum();
        (steady_m >= STEADY_SHARE * resolved_m).then_some(median)
    }

    /// The curve through the members: points at equal numbers of metres, each from a straight line through the members
    /// around it.
    fn curve(&self) -> Boundary {
        let mut curve = Boundary::default();
        let length_m: f64 = self.members.iter().map(|m| m.seen_m).sum();
        let spacing_m = (length_m / (MAX_POINTS - 2) as f64).max(1.0);
        let (mut since_m, mut solid_m) = (f64::INFINITY, 0.0);
        let last = self.members.len() - 1;
        for (i, member) in self.members.iter().enumerate() {
            since_m += member.seen_m;
            solid_m += if member.seen_m <= MAX_GAP_M { member.seen_m } else { 0.0 };
            if (since_m >= spacing_m || i == last)
                && let Some(point) = self.point(i)
            {
                curve.push(BoundaryPoint { solid_m, ..point });
                (since_m, solid_m) = (0.0, 0.0);
            }
        }
        curve
    }

    /// The point of the curve at a member.
    fn point(&self, index: usize) -> Option<BoundaryPoint> {
        const REACH_M: f64 = 1.5;
        const MIN_REACH: usize = 3;
        let here = self.members[index];
        let place = |m: &Member| [m.slope / m.inverse_m, 1.0 / m.inverse_m];
        let is_near = |m: &Member| {
            let ([a, b], [c, d]) = (place(m), place(&here));
            (a - c).hypot(b - d) <= REACH_M
        };
        let mut from = index;
        while from > 0 && (index - from < MIN_REACH || is_near(&self.members[from - 1])) {
            from -= 1;
        }
        let mut end = index + 1;
        while end < self.members.len() && (end - index <= MIN_REACH || is_near(&self.members[end])) {
            end += 1;
        }
        let around = &self.members[from..end];
        let n = around.len() as f64;
        let mean = |value: &dyn Fn(&Member) -> f64| around.iter().map(value).sum::<f64>() / n;
        let (slope, inverse_m) = (mean(&|m| m.slope), mean(&|m| m.inverse_m));
        let square = mean(&|m| (m.slope - slope).powi(2));
        let product = mean(&|m| (m.slope - slope) * (m.inverse_m - inverse_m));
        let rate = if square > 0.0 { product / square } else { 0.0 };
        let fitted = inverse_m + rate * (here.slope - slope);
        if fitted < 1e-3 {
            return None;
        }
        let residual = mean(&|m| (m.inverse_m - inverse_m - rate * (m.slope - slope)).powi(2));
        let px_at_1_m = self.rig.disparity_px(1.0);
        let leverage = if square > 0.0 { (here.slope - slope).powi(2) / square } else { 0.0 };
        let sigma = (residual.max((STIXEL_SIGMA_PX / px_at_1_m).powi(2)) * (1.0 + leverage) / n).sqrt();
        let line_m = 1.0 / rate.hypot(inverse_m - rate * slope).max(1e-6);
        Some(BoundaryPoint {
            lateral_m: here.slope / fitted,
            distance_m: 1.0 / fitted,
            height_m: mean(&|m| m.height_m),
            sigma_m: sigma * line_m / fitted,
            solid_m: 0.0,
            unseen_s: 0.0,
        })
    }
}
