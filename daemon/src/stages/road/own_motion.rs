//! The vehicle's own motion in the stage road: odometry, the filter that joins it with the vehicle's bus, and the record
//! in the header.

use crate::stages::motion::motion_record;
use crate::stages::stage::FrameContext;
use crate::stages::vehicle_record;
use messages::motion::{MotionRecord, health};
use perception::frame_clock::TimeStep;
use perception::image::GreyView;
use perception::motion::Motion;
use perception::motion::filter::{MotionFilter, MotionHealth};
use perception::motion::odometry::{Odometry, OdometryResult};
use perception::motion::pose::Pose;
use perception::motion::scene_point::ScenePoint;
use perception::rig::Rig;
use perception::stereo::DisparityView;

/// Own motion from the frames of a run.
pub struct OwnMotion {
    /// `None` if `motion.odometry` is off.
    odometry: Option<Odometry>,
    filter: MotionFilter,
    /// From the camera now to that of the first frame, or of the first one after a reset.
    pose: Pose,
    /// The same for the last frame that odometry measured; what it measures next refers to that.
    measured: Pose,
    inliers: u32,
    resets: u32,
    motion: Option<Motion>,
}

impl OwnMotion {
    /// For images of `size` (width, height).
    pub fn new(with_odometry: bool, rig: Rig, size: (usize, usize)) -> Self {
        Self {
            odometry: with_odometry.then(|| Odometry::new(rig, size.0, size.1)),
            filter: MotionFilter::default(),
            pose: Pose::IDENTITY,
            measured: Pose::IDENTITY,
            inliers: 0,
            resets: 0,
            motion: None,
        }
    }

    /// The motion at the time of the last frame; `None` if it is unknown.
    pub fn motion(&self) -> Option<Motion> {
        self.motion
    }

    /// Estimates the motion at the time of a frame from its left image and disparities, `None` if they show nothing new; returns it, if it
    /// is known. A gap or a step back in time starts anew; a repeated time changes nothing.
    pub fn update(
        &mut self,
        frame: &FrameContext,
        step: TimeStep,
        picture: Option<(GreyView<'_>, DisparityView<'_>)>,
    ) -> Option<Motion> {
        if step == TimeStep::Repeated {
            return self.motion;
        }
        if step.is_discontinuity() {
            self.filter.reset();
            (self.pose, self.measured) = (Pose::IDENTITY, Pose::IDENTITY);
            self.resets += 1;
            if let Some(odometry) = &mut self.odometry {
                odometry.reset();
            }
        }
        let elapsed_s = step.elapsed_s();
        let result = match (self.odometry.as_mut(), picture) {
            (Some(odometry), Some((left, disparity))) => Some(odometry.update(left, disparity, elapsed_s)),
            (Some(odometry), None) => {
                odometry.skip(elapsed_s);
                None
            }
            (None, _) => None,
        };
        let estimate = match &result {
            Some(OdometryResult::Known(estimate)) => Some(estimate),
            _ => None,
        };
        self.inliers = estimate.map_or(0, |e| e.inliers as u32);
        self.motion =
            self.filter.update(elapsed_s, estimate, &vehicle_record::reading(&frame.vehicle).sample);
        match estimate.filter(|_| self.filter.health().odometry) {
            Some(estimate) => {
                // It refers to an earlier frame, if the motion was not known meanwhile.
                self.pose = self.measured.after(&estimate.motion);
                self.measured = self.pose;
            }
            None => {
                let motion = self.motion.unwrap_or_default();
                let turn = Pose::from_rotation_vector([0.0, -motion.yaw_rate_rad_s * elapsed_s, 0.0]);
                let step = Pose { translation_m: [0.0, 0.0, motion.speed_m_s * elapsed_s], ..turn };
                self.pose = self.pose.after(&step);
                if self.odometry.as_ref().is_none_or(Odometry::starts_anew) {
                    self.measured = self.pose;
                }
            }
        }
        self.motion
    }

    /// The points that odometry found again in the last frame; none where its motion is not that of the vehicle.
    pub fn scene_points(&self) -> &[ScenePoint] {
        let health = self.filter.health();
        let counts = health.odometry && !health.disagree;
        self.odometry.as_ref().filter(|_| counts).map_or(&[], Odometry::scene_points)
    }

    /// The record for the header.
    pub fn record(&self) -> MotionRecord {
        let MotionHealth { odometry, bus_speed, bus_yaw_rate, disagree, standstill } = self.filter.health();
        let bits = [
            (self.motion.is_some(), health::KNOWN),
            (odometry, health::ODOMETRY),
            (bus_speed, health::BUS_SPEED),
            (bus_yaw_rate, health::BUS_YAW_RATE),
            (disagree, health::DISAGREE),
            (standstill, health::STANDSTILL),
        ];
        MotionRecord {
            position_m: self.pose.translation_m,
            orientation: self.pose.quaternion(),
            health: bits.iter().filter(|(is_set, _)| *is_set).map(|(_, bit)| bit).sum(),
            inliers: self.inliers,
            resets: self.resets,
            ..self.motion.as_ref().map(motion_record).unwrap_or_default()
        }
        .limited()
    }
}
