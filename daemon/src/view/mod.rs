//! The viewer: reads what the daemon publishes and shows it in a browser.
//!
//! One thread (`watcher`) reads shared memory and puts whole frames and states into the `hub`; one
//! thread for each connection (`server`, `session`) takes the newest from there when its client asks
//! for more. Pictures are encoded when the first client asks for them, once for all. So a slow client
//! costs frames of its own and nothing else, and nobody looking costs next to nothing.

pub mod access;
mod board;
mod frame;
mod history;
pub mod hub;
mod metrics;
mod prometheus;
mod request;
pub mod server;
mod session;
pub mod watcher;
