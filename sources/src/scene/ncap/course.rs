//! The motion of our vehicle and of the target in a test, and when they meet.

use super::case::Case;
use super::outline::Outline;
use super::row::{Gap, Miss, Motion, Place, turn_radius_m};
use crate::scene::file::BranchFile;
use crate::scene::motion::Waypoints;
use crate::scene::plan::{Plan, PlanPose};
use crate::scene::strip::Side;

/// Width of our vehicle, and how far it reaches behind and ahead of the left camera, in metres: the defaults of
/// `[vehicle]`, and the length of a car. The camera stands above the rear axle: it moves where it looks.
pub const OWN_WIDTH_M: f64 = 1.8;
/// See [`OWN_WIDTH_M`].
pub const OWN_REACH_M: (f64, f64) = (-2.7, 1.7);

/// Time from the start of a scene to the impact, in seconds: a track takes about one to be confirmed, and what is reported
/// earlier than 4 s before the impact is too early.
pub const LEAD_S: f64 = 5.2;

/// The same where we turn: we drive straight first.
const TURN_LEAD_S: f64 = 6.4;

/// The same where we turn across the path of an oncoming vehicle: it is met in the middle of the turn.
const ACROSS_LEAD_S: f64 = 8.4;

/// Time before the vehicle ahead brakes, in seconds.
const STEADY_S: f64 = 1.6;

/// What the vehicle ahead brakes to, in m/s: 2 km/h.
const BRAKED_M_S: f64 = 2.0 / 3.6;

/// Time between the points of a path, in seconds.
const STEP_S: f64 = 0.04;

/// How long the target goes on after the impact, in seconds: braking delays our arrival.
const AFTER_S: f64 = 5.0;

/// Deceleration of what stops before our path, in m/s²: walkers stop within half a step.
const STOP_M_S2: f64 = 3.0;

/// What stops before our path stands this long before we pass, in seconds: earlier than a warning is due.
const STOPS_BEFORE_S: f64 = 3.0;

/// Clearance of what drives or rides and stops before our path, in metres.
const STOP_CLEARANCE_M: f64 = 1.0;

/// Distance from the kerb to the middle of a person who stands at it, in metres.
const AT_KERB_M: f64 = 0.2;

/// Length of the transition to a turn, in metres.
const TRANSITION_M: f64 = 2.0;

/// Way from the end of a turn to where somebody crosses, in metres.
const BEHIND_TURN_M: f64 = 1.0;

/// Middle of the oncoming lane, in metres.
const OTHER_LANE_M: f64 = -3.5;

/// Lateral acceleration in the bend beside which a car is parked, in m/s².
const BEND_M_S2: f64 = 2.5;

/// Sharpest bend beside which a car is parked, in metres of radius.
const MIN_BEND_RADIUS_M: f64 = 25.0;

/// Distance of a parked car from our path in a bend, in metres.
const PARKED_CLEARANCE_M: f64 = 0.8;

/// How the target moves along a road.
#[derive(Clone, Debug, PartialEq)]
pub struct Way {
    /// Number of the road: 0 is ours, 1 the branch.
    pub road: usize,
    /// `[seconds, near side along the road, middle across it]`.
    pub points: Vec<[f64; 3]>,
    /// Yaw to the right, in degrees.
    pub yaw_deg: f64,
    /// Extent across and along the road, in metres.
    pub extent_m: [f64; 2],
}

/// The motion of both.
#[derive(Clone, Debug)]
pub struct Course {
    /// Our speed, in m/s.
    pub own_m_s: f64,
    /// Time at which the impact, or the passing, is planned, in seconds.
    pub lead_s: f64,
    /// Curvature of our road: `(along, 1/km)`.
    pub bend: Vec<(f64, f64)>,
    /// The road that branches off.
    pub branch: Option<BranchFile>,
    /// Right edge of the asphalt, in metres.
    pub right_edge_m: f64,
    /// The target.
    pub way: Way,
    /// Time from which the danger can be known by the target's motion, in seconds.
    pub begins_s: f64,
    plan: Plan,
}

impl Course {
    /// The motion in a run.
    pub fn new(case: &Case) -> Self {
        let row = case.row;
        let own_m_s = case.own_km_h / 3.6;
        let mut course = Self {
            own_m_s,
            lead_s: match (row.turn, row.motion) {
                (None, _) => LEAD_S,
                (Some(_), Motion::Comes(_)) => ACROSS_LEAD_S,
                (Some(_), _) => TURN_LEAD_S,
            },
            bend: vec![(0.0, 0.0)],
            branch: None,
            right_edge_m: 5.25,
            way: Way { road: 0, points: Vec::new(), yaw_deg: 0.0, extent_m: [0.0; 2] },
            begins_s: 0.0,
            plan: Plan::new(&Waypoints::constant(0.0), &[], (0.0, 0.0)),
        };
        if let Motion::Brakes(gap, m_s2) = row.motion {
            course.lead_s = course.lead_s.max(STEADY_S + closing_s(own_m_s, gap_m(gap, own_m_s), m_s2));
        }
        course.lay_out(case);
        let bend = Waypoints::new(course.bend.clone()).unwrap_or(Waypoints::constant(0.0));
        let branches: Vec<BranchFile> = course.branch.into_iter().collect();
        let span = (-100.0, own_m_s * (course.lead_s + AFTER_S) + 300.0);
        course.plan = Plan::new(&bend, &branches, span);
        course.move_target(case);
        course
    }

    /// Where our front arrives as planned, in metres along our road.
    pub fn meeting_m(&self) -> f64 {
        self.own_m_s * self.lead_s + OWN_REACH_M.1
    }

    /// The road: turns, bends, and what crosses.
    fn lay_out(&mut self, case: &Case) {
        if case.row.target.walks() {
            self.right_edge_m = 2.0;
        }
        if let Some(side) = case.row.turn {
            let (radius_m, sign) = (turn_radius_m(case.own_km_h), side.sign());
            // A quarter turn; both transitions together turn by one of their lengths.
            let arc_m = std::f64::consts::FRAC_PI_2 * radius_m - TRANSITION_M;
            let to = self.meeting_m() - BEHIND_TURN_M;
            let from = to - arc_m - 2.0 * TRANSITION_M;
            let bend = sign * 1000.0 / radius_m;
            self.bend = vec![(from, 0.0), (from + TRANSITION_M, bend), (to - TRANSITION_M, bend), (to, 0.0)];
            self.branch = Some(BranchFile { at_m: from, angle_deg: 0.0, from_m: 0.0, to_m: 90.0 });
        }
        if let Motion::Crosses { is_hidden, .. } = case.row.motion {
            if is_hidden {
                self.right_edge_m = 3.9;
            }
            if case.row.turn.is_none() && !case.row.target.walks() {
                let middle = self.meeting_m() + 0.5 * case.row.target.model().1[0];
                self.branch = Some(BranchFile { at_m: middle, angle_deg: 90.0, from_m: -75.0, to_m: 75.0 });
            }
        }
        if case.miss == Some(Miss::InBend) {
            // To the left, so that the car at the right edge stands straight ahead.
            let radius_m = (self.own_m_s * self.own_m_s / BEND_M_S2).max(MIN_BEND_RADIUS_M);
            let from = (self.meeting_m() - 0.5 * radius_m).max(5.0);
            let to = self.meeting_m() + 30.0;
            let bend = -1000.0 / radius_m;
            self.bend = vec![(from, 0.0), (from + 5.0, bend), (to, bend), (to + 5.0, 0.0)];
        }
    }

    fn move_target(&mut self, case: &Case) {
        let [width, _, length] = case.row.target.model().1;
        let (meeting, end_s) = (self.meeting_m(), self.lead_s + AFTER_S);
        let count = (end_s / STEP_S).ceil() as u32;
        let times = (0..=count).map(|k| f64::from(k) * STEP_S);
        let lateral = self.lateral_m(case);
        let mut straight = |yaw_deg: f64, along: &dyn Fn(f64) -> f64| {
            let points = times.clone().map(|t| [t, along(t), lateral]).collect();
            self.way = Way { road: 0, points, yaw_deg, extent_m: [width, length] };
        };
        match case.row.motion {
            Motion::Stands => straight(0.0, &|_| meeting),
            Motion::Leads(km_h) => {
                let lead_s = self.lead_s;
                straight(0.0, &|t| meeting - km_h / 3.6 * (lead_s - t));
            }
            Motion::Brakes(gap, m_s2) => {
                let (own, lead_s, gap) = (self.own_m_s, self.lead_s, gap_m(gap, self.own_m_s));
                self.begins_s = lead_s - closing_s(own, gap, m_s2);
                let begins_s = self.begins_s;
                straight(0.0, &|t| OWN_REACH_M.1 + own * t + gap - closed_m(own, m_s2, t - begins_s));
            }
            Motion::Comes(km_h) if case.row.turn.is_none() => {
                let lead_s = self.lead_s;
                straight(180.0, &|t| meeting + km_h / 3.6 * (lead_s - t));
            }
            Motion::Comes(km_h) => self.across_turn(case, km_h / 3.6),
            Motion::Crosses { from, km_h, start_m, .. } => self.across(case, from, km_h / 3.6, start_m),
        }
    }

    /// Middle of the target across our road at the impact or when it is passed, in metres.
    fn lateral_m(&self, case: &Case) -> f64 {
        let width = match case.row.motion {
            Motion::Crosses { .. } => case.row.target.model().1[2],
            _ => case.row.target.model().1[0],
        };
        let touching = 0.5 * (OWN_WIDTH_M + width);
        let from = match case.row.motion {
            Motion::Crosses { from, .. } => from,
            _ => Side::Left,
        };
        match (case.miss, case.place) {
            (Some(Miss::Beside(clearance)), _) => match case.row.motion {
                Motion::Comes(_) => -touching - clearance,
                _ => touching + clearance,
            },
            (Some(Miss::HasPassed(clearance)), _) => -from.sign() * (touching + clearance),
            (Some(Miss::InBend), _) => touching + PARKED_CLEARANCE_M,
            (Some(Miss::OwnLane | Miss::Earlier(_)), _) => OTHER_LANE_M,
            (Some(Miss::Stops), _) if case.row.target.walks() => match from {
                Side::Left => -5.25 - AT_KERB_M,
                Side::Right => self.right_edge_m + AT_KERB_M,
            },
            (Some(Miss::Stops), _) => from.sign() * (touching + STOP_CLEARANCE_M),
            (None, Place::Overlap(percent)) => {
                let overlap = f64::from(percent.abs()) / 100.0 * OWN_WIDTH_M;
                f64::from(percent.signum()) * (touching - overlap).max(0.0)
            }
            (None, Place::At(percent)) => from.sign() * OWN_WIDTH_M * (0.5 - f64::from(percent) / 100.0),
        }
    }

    /// Across our road: it stands first, or moves all the time, and may stop again.
    fn across(&mut self, case: &Case, from: Side, m_s: f64, start_m: f64) {
        let [width, _, length] = case.row.target.model().1;
        let (last, sign) = (self.lateral_m(case) * from.sign(), from.sign());
        let lead_s = self.lead_s;
        let stops = case.miss == Some(Miss::Stops);
        let meets_s = if stops { lead_s - STOPS_BEFORE_S } else { lead_s };
        // Distance aside, on the side from which it comes.
        let aside = |t: f64| {
            let before_s = meets_s - t;
            let moving = if stops {
                let braking_s = m_s / STOP_M_S2;
                let slow_s = before_s.clamp(0.0, braking_s);
                last + 0.5 * STOP_M_S2 * slow_s * slow_s + m_s * (before_s - braking_s).max(0.0)
            } else {
                last + m_s * before_s
            };
            moving.min(start_m)
        };
        if start_m.is_finite() {
            self.begins_s = (meets_s - (start_m - last) / m_s).max(0.0);
        }
        let count = ((lead_s + AFTER_S) / STEP_S).ceil() as u32;
        let meeting = self.meeting_m();
        let point = |t: f64| [t, meeting, sign * aside(t)];
        let points = (0..=count).map(|k| point(f64::from(k) * STEP_S)).collect();
        self.way = Way { road: 0, points, yaw_deg: -90.0 * sign, extent_m: [length, width] };
    }

    /// On the road that goes straight on where we turn left: its front and ours meet in the middle of its lane.
    fn across_turn(&mut self, case: &Case, m_s: f64) {
        let [width, _, length] = case.row.target.model().1;
        let start = self.plan.at(1, 0.0);
        let own = |way_m: f64| self.own(way_m).corners().map(|corner| start.local(corner));
        let least =
            |way_m: f64, axis: usize| own(way_m).iter().map(|c| c[axis]).fold(f64::INFINITY, f64::min);
        let front = |way_m: f64| start.local(self.plan.road(way_m).point(0.0, OWN_REACH_M.1));
        let steps = (self.own_m_s * self.lead_s / 0.01) as u32;
        let mut ways = (0..=steps).map(|k| f64::from(k) * 0.01);
        let (meets_m, at) = if let Some(Miss::Earlier(earlier_s)) = case.miss {
            let enters_m = ways.find(|&way| least(way, 0) < OTHER_LANE_M + 0.5 * width).unwrap_or(0.0);
            (enters_m, least(enters_m, 1) - length - m_s * earlier_s)
        } else {
            let meets_m = ways.find(|&way| front(way)[0] < OTHER_LANE_M).unwrap_or(0.0);
            (meets_m, front(meets_m)[1])
        };
        let meets_s = meets_m / self.own_m_s;
        let count = ((self.lead_s + AFTER_S) / STEP_S).ceil() as u32;
        let point = |t: f64| [t, at + m_s * (meets_s - t), OTHER_LANE_M];
        let points = (0..=count).map(|k| point(f64::from(k) * STEP_S)).collect();
        self.way = Way { road: 1, points, yaw_deg: 180.0, extent_m: [width, length] };
        self.begins_s = self.bend[0].0 / self.own_m_s;
    }

    /// Our pose when the camera has driven so far, in metres.
    pub fn own_pose(&self, way_m: f64) -> PlanPose {
        self.plan.road(way_m)
    }

    /// Our outline there.
    pub fn own(&self, way_m: f64) -> Outline {
        Outline::about(self.own_pose(way_m), OWN_WIDTH_M, OWN_REACH_M)
    }

    /// Near side along its road and middle across it at a time, in metres.
    fn target_at(&self, time_s: f64) -> (f64, f64) {
        let points = &self.way.points;
        let after = points.partition_point(|p| p[0] <= time_s).clamp(1, points.len().max(2) - 1);
        match (points.get(after - 1), points.get(after)) {
            (Some(a), Some(b)) => {
                let share = ((time_s - a[0]) / (b[0] - a[0])).clamp(0.0, 1.0);
                (a[1] + share * (b[1] - a[1]), a[2] + share * (b[2] - a[2]))
            }
            _ => points.first().map_or((0.0, 0.0), |p| (p[1], p[2])),
        }
    }

    /// The target's outline at a time: along the chord between its ends, as scenes place it.
    pub fn target(&self, time_s: f64) -> Outline {
        let [across_m, along_m] = self.way.extent_m;
        let (along, lateral) = self.target_at(time_s);
        let end = |along_m: f64| self.plan.at(self.way.road, along_m).point(lateral, 0.0);
        let ([ax, az], [bx, bz]) = (end(along), end(along + along_m));
        let pose = PlanPose { x_m: ax, z_m: az, heading_rad: (bx - ax).atan2(bz - az) };
        Outline::about(pose, across_m, (0.0, along_m))
    }

    /// Whether both touch when we have driven so far, in metres, at a time.
    pub fn touches(&self, way_m: f64, time_s: f64) -> bool {
        self.own(way_m).touches(&self.target(time_s))
    }

    /// The target's speed in the direction in which we look at a time, in m/s.
    pub fn target_m_s(&self, way_m: f64, time_s: f64) -> f64 {
        let [a, b] = [time_s - 0.5 * STEP_S, time_s + 0.5 * STEP_S].map(|t| self.target(t.max(0.0)).middle);
        let pose = self.own_pose(way_m);
        (pose.local([b.x_m, b.z_m])[1] - pose.local([a.x_m, a.z_m])[1]) / STEP_S
    }

    /// Time of the impact if we drive on, in seconds; `None` if there is none. Exact to a microsecond.
    pub fn impact_s(&self) -> Option<f64> {
        let hits = |t: f64| self.touches(self.own_m_s * t, t);
        let count = ((self.lead_s + AFTER_S) / 1e-3) as u32;
        let first = (0..=count).map(|k| f64::from(k) * 1e-3).find(|&t| hits(t))?;
        let (mut from, mut to) = (first - 1e-3, first);
        while to - from > 1e-6 {
            let middle = 0.5 * (from + to);
            if hits(middle) { to = middle } else { from = middle }
        }
        Some(to)
    }
}

fn gap_m(gap: Gap, own_m_s: f64) -> f64 {
    match gap {
        Gap::Metres(m) => m,
        Gap::Seconds(s) => s * own_m_s,
    }
}

/// By how much the gap to a vehicle that brakes closes in a time, in metres.
fn closed_m(own_m_s: f64, m_s2: f64, time_s: f64) -> f64 {
    let slower = own_m_s - BRAKED_M_S;
    let braking_s = time_s.clamp(0.0, slower / m_s2);
    0.5 * m_s2 * braking_s * braking_s + slower * (time_s.max(0.0) - braking_s)
}

/// Time in which a gap to a vehicle that brakes closes, in seconds.
fn closing_s(own_m_s: f64, gap_m: f64, m_s2: f64) -> f64 {
    let slower = own_m_s - BRAKED_M_S;
    let while_braking_m = 0.5 * slower * slower / m_s2;
    if gap_m <= while_braking_m {
        (2.0 * gap_m / m_s2).sqrt()
    } else {
        slower / m_s2 + (gap_m - while_braking_m) / slower
    }
}
