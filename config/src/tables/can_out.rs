//! What is sent on a CAN bus.

use crate::key::Reload;
use crate::table::table;

table! {
    /// CAN out, sent by `lookout can` (docs/can.md): alarm, health, nearest obstacle, path and obstacles, for displays and
    /// loggers. It is information only: nothing in it is a request to the vehicle.
    pub struct CanOut, reload: Reload::OtherProcess;

    /// CAN interface that frames are sent on, such as can0; needs a build with the feature `can`. If empty, nothing is
    /// sent.
    interface: Text(15) = "";

    /// First identifier; 32 identifiers from there on belong to lookout. Those of diagnostics (0x7df to 0x7ef, and 0x18da0000
    /// to 0x18dbffff) are refused.
    base_id: Whole(0, 0x1fff_ffe0) = 0x640;

    /// Sends extended identifiers (29 bits) instead of standard ones (11 bits).
    extended_ids: Switch = false;

    /// Period of all frames, also while there is no new result.
    period_ms: Whole(10, 1_000) in "ms" = 50;

    /// Number of obstacles that are sent, the nearest first.
    objects: Whole(0, 8) = 8;

    /// Of a result whose images are older than this only the age is sent; the alarm is off then.
    stale_ms: Whole(50, 60_000) in "ms" = 500;
}
