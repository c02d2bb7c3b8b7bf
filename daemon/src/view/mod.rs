//! The viewer: shows the daemon's messages in a browser.
//!
//! One thread (`watcher`) reads shared memory and puts complete frames and statuses into the `hub`. One
//! thread per connection (`server`, `session`) takes the newest ones from there when its client requests
//! more. Pictures are encoded on the first request and shared by all clients. A slow client therefore
//! loses frames without affecting anything else, and without clients there is almost no load.

pub mod access;
mod board;
mod connections;
pub mod frame;
mod history;
pub mod hub;
mod metrics;
mod prometheus;
mod request;
pub mod server;
mod session;
pub mod watcher;

#[cfg(test)]
mod tests;
