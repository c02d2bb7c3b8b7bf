//! When the daemon warns and raises an alarm.

use crate::key::Reload;
use crate::table::table;
use perception::alarm::AlarmParameters as Rules;

table! {
    /// Rules of warnings and alarms.
    pub struct Alarm, reload: Reload::Readers;

    /// Alarm if an obstacle in the path is nearer than this. Cannot be disabled.
    distance_m: Number(0.5, 200.0) in "m" = Rules::default().distance_m;

    /// Where the own speed is known, `distance_m` is reduced to the way driven within this time plus 2 m: at 2 s to 6 m at
    /// 2 m/s. 0 keeps `distance_m` at any speed.
    distance_s: Number(0.0, 20.0) in "s" = Rules::default().distance_s;

    /// Warning if the time to collision with an obstacle in the path is less than this; 0 disables the rule. It is
    /// the time until the vehicle's front (`vehicle.front_m`) is there; what brakes goes on braking.
    ttc_warning_s: Number(0.0, 10.0) in "s" = Rules::default().ttc_warning_s;

    /// Alarm if that time is less than this; 0 disables the rule.
    ttc_alarm_s: Number(0.0, 10.0) in "s" = Rules::default().ttc_alarm_s;

    /// Warning if stopping before an obstacle in the path needs a higher deceleration than this; 0 disables the
    /// rule.
    deceleration_warning_m_s2: Number(0.0, 20.0) in "m/s²" = Rules::default().deceleration_warning_m_s2;

    /// Alarm if stopping before an obstacle in the path needs a higher deceleration than this; 0 disables the
    /// rule.
    deceleration_alarm_m_s2: Number(0.0, 20.0) in "m/s²" = Rules::default().deceleration_alarm_m_s2;

    /// Width of the straight path that counts while the own motion is unknown, centred on the camera axis; an obstacle is
    /// in it if any part of it is. With known motion the path is what the body (`[vehicle]`) sweeps.
    path_width_m: Number(0.5, 20.0) in "m" = Rules::default().path_width_m, reload: Reload::AllStages;

    /// Number of consecutive frames in which a rule must hold. Rules are evaluated on the prediction for the
    /// end of that time.
    confirm_frames: Whole(1, 100) in "frames" = Rules::default().confirm_frames;

    /// Hysteresis: a raised level ends when its limit is missed by this share of it (0.15 = 15 %). Larger values are steadier and
    /// keep the level longer.
    clear_share: Number(0.0, 2.0) = Rules::default().clear_share;

    /// A level is held for this time after its cause has gone.
    hold_ms: Whole(0, 60_000) in "ms" = Rules::default().hold_ns / 1_000_000;

    /// The alarm is off for frames that are older than this when a stage receives them; 0 allows any age. Lock-step
    /// ignores this key.
    frame_age_max_ms: Whole(0, 60_000) in "ms" = 500, reload: Reload::AllStages;

    /// Turns the alarm off, with the reason, while the images are too dark, too bright, blocked or too different
    /// from each other, or the road has too little texture.
    self_check: Switch = true, reload: Reload::AllStages;
}
