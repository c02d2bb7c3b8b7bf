//! The quick tests that run the binary, linked as one program: linking the daemon's libraries once takes less time than once for
//! each of them. A module that takes long goes to `slow.rs`; its line is all that moves.

mod alarm_states;
mod architecture;
mod bad_input;
mod board;
mod calibrate;
mod calibrate_boards;
mod can_out;
mod clients;
mod commands;
mod documented_outputs;
mod evaluate;
mod evaluate_drive;
mod evaluate_ncap;
mod faults;
mod features;
mod limits;
mod mistakes;
mod odometry;
mod package;
mod pipeline;
mod point_cloud;
mod realtime;
mod recognition;
mod recording;
mod scenes;
mod stream;
mod support;
mod systemd;
mod vehicle;
mod video;
mod viewer_protocol;
