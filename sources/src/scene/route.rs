//! The vehicle's way along the road: where it stands at a time, and how it moves.

use super::file::SceneFile;
use super::ground::Course;
use super::mesh::Point;
use super::motion::Waypoints;
use super::plan::{Plan, PlanPose};
use super::truth::OwnMotion;
use super::view;
use perception::motion::pose::Pose;

/// Length of the road that is known behind and ahead of the drive, in metres. Beyond it is straight.
const MARGIN_M: (f64, f64) = (100.0, 300.0);

/// Times at which the extent of the drive is looked for; between two of them the vehicle may go farther by the margin.
const LOOKED_AT: u32 = 512;

/// Step of numerical derivatives by time, in seconds.
const STEP_S: f64 = 1e-4;

/// Step of the integration over a road whose grade changes, in seconds.
const CLIMB_STEP_S: f64 = 0.01;

/// Least speed for the direction of lateral motion, in m/s: slower, the vehicle slides.
const CRAWL_M_S: f64 = 1.0;

/// The road, and the vehicle's motion along it.
#[derive(Clone, Debug)]
pub struct Route {
    /// Horizontal course of the road and its branches.
    pub plan: Plan,
    /// Vertical course of the road.
    pub course: Course,
    speed_m_s: Waypoints,
    lateral_m: Waypoints,
    start_m: f64,
    turns: bool,
}

/// Where the vehicle stands at a time.
#[derive(Clone, Copy, Debug)]
pub struct Standpoint {
    /// Metres along the road.
    pub along_m: f64,
    /// Metres to the right of its reference line.
    pub lateral_m: f64,
    /// Position and direction of the vehicle on the ground plane.
    pub at: PlanPose,
    /// Height of the road there, in metres.
    rise_m: f64,
    /// Grade of the road there.
    grade: f64,
}

impl Standpoint {
    /// Rise of what is level, in the vehicle's frame: metres for each metre ahead.
    pub fn tilt(&self) -> f64 {
        -self.grade
    }

    /// A point of the ground plane, `rise_m` high, in the vehicle's frame: x right, y up, z ahead. The vehicle stands level
    /// on the road.
    pub fn see(&self, plan: [f64; 2], rise_m: f64) -> Point {
        let [right, ahead] = self.at.local(plan);
        [right, rise_m - self.rise_m - self.grade * ahead, ahead]
    }
}

impl Route {
    /// The route described by a file.
    pub fn new(file: &SceneFile) -> Self {
        let (speed_m_s, start_m) = (file.ego.speed_m_s.clone(), file.ego.along_m);
        let course = Course::new(&file.road);
        let lateral_m = file.ego.lateral_m.clone();
        let steers = !lateral_m.is_always(lateral_m.value(0.0));
        let mut route = Self {
            plan: Plan::new(&Waypoints::constant(0.0), &[], (0.0, 0.0)),
            course,
            speed_m_s,
            lateral_m,
            start_m,
            turns: steers || !file.road.branch.is_empty() || !file.road.bend_per_km.is_always(0.0),
        };
        if route.turns {
            let span_m = route.span_m(file.seconds);
            route.plan = Plan::new(&file.road.bend_per_km, &file.road.branch, span_m);
        }
        route
    }

    /// The part of the road that is known, from and to.
    fn span_m(&self, seconds: f64) -> (f64, f64) {
        let places = (0..=LOOKED_AT).map(|k| self.along_m(seconds * f64::from(k) / f64::from(LOOKED_AT)));
        let between_m = self.speed_m_s.max_abs() * seconds / f64::from(LOOKED_AT);
        let (from, to) = places.fold((f64::MAX, f64::MIN), |(from, to), at| (from.min(at), to.max(at)));
        (from - MARGIN_M.0 - between_m, to + MARGIN_M.1 + between_m)
    }

    /// Whether the vehicle turns relative to the world, or roads branch off. If not, the world is seen from a straight road.
    pub fn turns(&self) -> bool {
        self.turns
    }

    /// Position of the vehicle along the road at a time, in metres.
    pub fn along_m(&self, time_s: f64) -> f64 {
        self.start_m + self.speed_m_s.integral(time_s) - self.speed_m_s.integral(0.0)
    }

    /// Position of the vehicle across the road at a time, in metres, and its rate, in m/s.
    fn lateral_m(&self, time_s: f64) -> (f64, f64) {
        self.lateral_m.smooth(time_s)
    }

    /// Way of the vehicle from one position along the road to another, in metres: shorter than along the reference line on the
    /// inside of a bend.
    pub fn way_m(&self, from_m: f64, to_m: f64, lateral_m: f64) -> f64 {
        let turn_rad = self.plan.road(to_m).heading_rad - self.plan.road(from_m).heading_rad;
        (to_m - from_m) - lateral_m * turn_rad
    }

    /// Speed in the direction of the road and to the right of it, in m/s.
    fn velocity_m_s(&self, time_s: f64) -> (f64, f64) {
        let (lateral, across) = self.lateral_m(time_s);
        let bend = self.plan.curvature_per_m(self.along_m(time_s));
        (self.speed_m_s.value(time_s) * (1.0 - lateral * bend), across)
    }

    /// Where the vehicle stands at a time.
    pub fn stand(&self, time_s: f64) -> Standpoint {
        let along_m = self.along_m(time_s);
        let (lateral_m, _) = self.lateral_m(time_s);
        let road = self.plan.road(along_m);
        let (along_m_s, across_m_s) = self.velocity_m_s(time_s);
        let drift_rad = (across_m_s / along_m_s.abs().max(CRAWL_M_S)).atan() * along_m_s.signum();
        let [x_m, z_m] = road.point(lateral_m, 0.0);
        Standpoint {
            along_m,
            lateral_m,
            at: PlanPose { x_m, z_m, heading_rad: road.heading_rad + drift_rad },
            rise_m: self.course.rise_m(along_m),
            grade: self.course.grade(along_m),
        }
    }

    /// Speed of the vehicle, in m/s.
    fn speed_m_s(&self, time_s: f64) -> f64 {
        let (along, across) = self.velocity_m_s(time_s);
        if across == 0.0 { along } else { along.hypot(across) * along.signum() }
    }

    /// The vehicle's motion with its left camera at `camera` in the vehicle's frame, which was at `first` at time 0.
    pub fn motion(&self, time_s: f64, first: &view::Pose, camera: &view::Pose) -> OwnMotion {
        let rate = |of: &dyn Fn(f64) -> f64| (of(time_s + STEP_S) - of(time_s - STEP_S)) / (2.0 * STEP_S);
        OwnMotion {
            speed_m_s: self.speed_m_s(time_s),
            acceleration_m_s2: rate(&|t| self.speed_m_s(t)),
            yaw_rate_rad_s: -rate(&|t| self.stand(t).at.heading_rad),
            pose: self.camera(0.0, first).inverse().after(&self.camera(time_s, camera)),
        }
    }

    /// Inclination of the road below the vehicle, in rad; a constant one has no meaning.
    fn climb_rad(&self, along_m: f64) -> f64 {
        if self.course.is_even() && self.plan.is_straight() { 0.0 } else { self.course.grade(along_m).atan() }
    }

    /// Position of the vehicle: x right, y up, z ahead, in metres.
    fn position_m(&self, time_s: f64, stand: &Standpoint) -> Point {
        let is_level = self.course.is_even() && self.climb_rad(0.0) == 0.0;
        if is_level {
            return [stand.at.x_m, 0.0, stand.at.z_m];
        }
        let start = self.plan.road(self.start_m).point(self.lateral_m(0.0).0, 0.0);
        let mut at = [start[0], 0.0, start[1]];
        let steps = (time_s / CLIMB_STEP_S).ceil().max(1.0);
        let step_s = time_s / steps;
        for k in 0..steps as u32 {
            let middle_s = (f64::from(k) + 0.5) * step_s;
            let way_m = self.speed_m_s(middle_s) * step_s;
            let there = self.stand(middle_s);
            let (sin, cos) = self.climb_rad(there.along_m).sin_cos();
            let (right, ahead) = there.at.heading_rad.sin_cos();
            for (at, direction) in at.iter_mut().zip([cos * right, sin, cos * ahead]) {
                *at += way_m * direction;
            }
        }
        at
    }

    /// Transform from the camera to the world: x right, y down, z ahead.
    fn camera(&self, time_s: f64, camera: &view::Pose) -> Pose {
        let stand = self.stand(time_s);
        let (sin, cos) = self.climb_rad(stand.along_m).sin_cos();
        // From the vehicle's frame (y up) to the world's (y down): tilted with the road, then turned.
        let world = |p: Point| {
            let level = [p[0], p[1] * cos + p[2] * sin, p[2] * cos - p[1] * sin];
            let turned = PlanPose { x_m: 0.0, z_m: 0.0, ..stand.at }.point(level[0], level[2]);
            [turned[0], -level[1], turned[1]]
        };
        let axes = camera.axes().map(world);
        let position = self.position_m(time_s, &stand);
        let lens = world([0.0, camera.height_m(), 0.0]);
        Pose {
            rotation: std::array::from_fn(|row| std::array::from_fn(|column| axes[column][row])),
            translation_m: [position[0] + lens[0], lens[1] - position[1], position[2] + lens[2]],
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn route(text: &str) -> Route {
        let head = "title = \"x\"\nseconds = 20\n";
        Route::new(&SceneFile::parse(&format!("{head}{text}"), "x.toml").unwrap())
    }

    #[test]
    fn speed_yaw_rate_and_acceleration_are_those_of_the_path() {
        let bend = "[road]\nbend_per_km = [[10, 0], [20, 30], [60, 30], [70, -25]]\n";
        let ego =
            "[ego]\nspeed_m_s = [[0, 8], [4, 8], [8, 3], [12, 9]]\nlateral_m = [[2, 1.75], [6, -1.75]]\n";
        let route = route(&format!("{ego}{bend}"));
        let camera = view::Pose::new(1.25, 0.0, 0.0);
        for k in 0..190 {
            let (time, step) = (0.105 + 0.1 * f64::from(k), 1e-3);
            let [a, b, c] = [time - step, time, time + step].map(|t| route.stand(t).at);
            let [right, ahead] = a.local([c.x_m, c.z_m]);
            let motion = route.motion(time, &camera, &camera);
            assert!((right.hypot(ahead) / (2.0 * step) - motion.speed_m_s).abs() < 2e-3, "{time}");
            assert!(
                ((a.heading_rad - c.heading_rad) / (2.0 * step) - motion.yaw_rate_rad_s).abs() < 2e-3,
                "{time}"
            );
            // It drives where it looks.
            let [right, _] = b.local([c.x_m, c.z_m]);
            assert!(right.abs() < 2e-5, "{time}: {right}");
        }
        let motion = route.motion(6.5, &camera, &camera);
        assert!((motion.acceleration_m_s2 + 1.25 * (1.0 - 0.03 * -1.75)).abs() < 0.2, "{motion:?}");
        assert!(route.motion(3.0, &camera, &camera).yaw_rate_rad_s < 0.0, "to the right");
    }

    #[test]
    fn the_pose_is_that_of_the_camera() {
        let camera = view::Pose::new(1.25, 0.0, 0.0);
        // A quarter turn to the left of 10 m radius at 1.75 m to the right: 11.75 m ahead and to the left.
        let turn = route("[ego]\nspeed_m_s = 5\nlateral_m = 1.75\n[road]\nbend_per_km = -100\n");
        let motion = turn.motion(std::f64::consts::PI, &camera, &camera);
        let at = motion.pose.translation_m;
        assert!((at[0] + 11.75).abs() < 1e-6 && at[1].abs() < 1e-9 && (at[2] - 11.75).abs() < 1e-6, "{at:?}");
        assert!((motion.pose.yaw_rad() - std::f64::consts::FRAC_PI_2).abs() < 1e-9);
        assert!((motion.yaw_rate_rad_s - 0.5).abs() < 1e-6 && (motion.speed_m_s - 5.875).abs() < 1e-9);
        // Up a slope and straight on: only ahead. Over a crest the nose goes down.
        let slope = route("[ego]\nspeed_m_s = 5\n[road]\ngrade_percent = 6\n").motion(4.0, &camera, &camera);
        assert_eq!(
            (slope.pose.translation_m, slope.pose.rotation),
            ([0.0, 0.0, 20.0], Pose::IDENTITY.rotation)
        );
        let crest = route("[ego]\nspeed_m_s = 5\n[road]\ngrade_percent = [[10, 0], [30, -10]]\n");
        let pose = crest.motion(8.0, &camera, &camera).pose;
        let nose = pose.rotate([0.0, 0.0, 1.0]);
        assert!((nose[1] / nose[2] - 0.1).abs() < 1e-9 && pose.translation_m[1] > 1.9, "{pose:?}");
        // Pitched nose down by 2 degrees.
        let pitched = view::Pose::new(1.25, 2.0_f64.to_radians(), 0.0);
        let pose = turn.motion(0.0, &camera, &pitched).pose;
        assert!((pose.rotate([0.0, 0.0, 1.0])[1] - 2.0_f64.to_radians().sin()).abs() < 1e-12);
        assert!(pose.translation_m.iter().all(|v| v.abs() < 1e-12));
    }
}
