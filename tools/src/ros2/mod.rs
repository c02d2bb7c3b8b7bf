//! Messages of ROS 2 for `lookout bridge`: what a frame is in standard messages ([`messages`]), how they are serialised
//! ([`cdr`]), and under which names ROS 2 over zenoh finds them ([`names`]).

pub mod cdr;
pub mod messages;
pub mod names;
