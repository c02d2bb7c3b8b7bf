//! The tests that take long: `cargo test --release --workspace --test slow`, which `.ci/run` runs, too. A module that
//! has become quick goes to `quick.rs`; its line is all that moves.

mod calibrate_drive;
mod calibration_health;
mod client_users;
mod damaged_memory;
mod faults_lockstep;
mod fuzz;
mod realtime_load;
mod recording_readers;
mod row_offset_cost;
mod scene_approaches;
mod second_user;
mod shifted_view;
mod soak;
mod source_time;
mod stream_restarts;
mod support;
mod survival;
mod viewer;
mod viewer_cost;
