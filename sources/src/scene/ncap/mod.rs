//! Scenes of the standard tests of forward-collision systems, and their near misses.
//!
//! [`row::ROWS`] declares the tests as numbers; [`case::Case`] is one run of a row: a speed, a place of impact, weather,
//! rig and seed. [`course::Course`] has the exact motion of both, and so the time of the impact if nobody brakes;
//! [`text::text`] is the scene as a file. The tests are those of Euro NCAP by the public OpenSCENARIO descriptions
//! (vectorgrp/OSC-NCAP-scenarios); only numbers are taken over, the scenes are our own.

pub mod case;
pub mod course;
pub mod outline;
pub mod row;
#[cfg(test)]
mod tests;
pub mod text;
