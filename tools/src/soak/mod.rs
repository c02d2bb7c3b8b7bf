//! Soak tests: statistics in bounded memory, fault injection, recoveries, budgets and the report. All of it is
//! pure; `lookout soak` provides the measurements.

pub mod ambient;
pub mod budget;
pub mod delays;
pub mod director;
pub mod fault;
pub mod latency;
pub mod markdown;
pub mod paper;
pub mod recovery;
pub mod report;
pub mod stalls;
pub mod trend;
