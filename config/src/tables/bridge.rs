//! What goes to a fleet.

use crate::key::Reload;
use crate::table::table;

table! {
    /// Results for fleets and for ROS 2 over zenoh, sent by `lookout bridge` (docs/fleet.md); needs a build with the feature
    /// `zenoh`. Rates are maxima: the newest frame wins.
    pub struct Bridge, reload: Reload::OtherProcess;

    /// Name of the fleet, the second part of each key.
    fleet: Name(64) = "fleet";

    /// Name of the vehicle in its fleet, the third part of each key: letters, digits, `-` and `_`. If empty, the host's name.
    vehicle: Text(64) = "";

    /// Whether this vehicle connects to routers only (client), or also to other peers and accepts them (peer).
    mode: Choice(&["client", "peer"]) = "client";

    /// Endpoints to connect to, separated by commas, such as `tls/fleet.example.com:7447`: the first that answers in mode
    /// client, all of them in mode peer.
    connect: Text(1024) = "tcp/localhost:7447";

    /// Endpoints to listen on in mode peer, separated by commas, such as `tcp/127.0.0.1:7448`. If empty, none.
    listen: Text(1024) = "";

    /// Certificates of the authority that endpoints `tls/…` must be signed by (PEM).
    tls_ca: Path = "";

    /// Certificate of this vehicle for endpoints `tls/…` (PEM). With it, both sides authenticate each other.
    tls_certificate: Path = "";

    /// Private key of that certificate (PEM).
    tls_key: Path = "";

    /// Maximum rate of the key `obstacles`; 0 = never.
    obstacles_hz: Number(0.0, 100.0) in "1/s" = 2.0;

    /// Maximum rate of the key `alarm`; 0 = never. A change of the level is sent at once.
    alarm_hz: Number(0.0, 100.0) in "1/s" = 2.0;

    /// Maximum rate of the key `motion`; 0 = never.
    motion_hz: Number(0.0, 100.0) in "1/s" = 2.0;

    /// Rate of the key `status`; 0 = never.
    status_hz: Number(0.0, 1.0) in "1/s" = 0.2;

    /// Number of JPEG pictures with each event: half of them from before it.
    pictures: Whole(0, 16) = 3;

    /// Time between two of these pictures.
    picture_period_ms: Whole(50, 60_000) in "ms" = 500;

    /// Answers requests for a point cloud.
    cloud: Switch = true;

    /// Sends standard messages of ROS 2 as well, under the names of rmw_zenoh.
    ros2: Switch = false;

    /// Domain of ROS 2 (`ROS_DOMAIN_ID`).
    ros2_domain: Whole(0, 232) = 0;

    /// Maximum rate of detections and odometry for ROS 2; 0 = never.
    ros2_hz: Number(0.0, 100.0) in "1/s" = 10.0;

    /// Maximum rate of picture and disparity map for ROS 2, which have 5 bytes a pixel together; 0 = never.
    ros2_images_hz: Number(0.0, 100.0) in "1/s" = 1.0;

    /// Memory for what cannot be sent at once; the oldest is dropped and counted. Images for ROS 2 are not kept while there
    /// is no network.
    buffer_mb: Whole(1, 1024) in "MB" = 8;

    /// Folder in which events wait until they are sent, and from which they are read again on request. If empty:
    /// `$STATE_DIRECTORY`, which systemd sets, or `~/.local/state/lookout`.
    spool: Path = "";

    /// Disk space for events with their pictures; the oldest are removed.
    spool_mb: Whole(1, 1_000_000) in "MB" = 64;
}
