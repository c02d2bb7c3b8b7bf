//! Results as lines of JSON for other programs: on standard output, and on a Unix socket that a group may read.
//!
//! A feed (`follower` from shared memory, `relay` from a socket) turns each frame into a line (`runs`, `line`) and puts
//! it into `latest`, which holds one line. `sender` takes the newest line from there whenever its reader can take one, so a
//! reader that stalls loses lines, and nothing waits for it. `server` has one sender for each client of the `socket`.

pub mod follower;
pub mod latest;
pub mod line;
mod notice;
pub mod relay;
pub mod runs;
pub mod sender;
pub mod server;
pub mod socket;
pub mod topics;
