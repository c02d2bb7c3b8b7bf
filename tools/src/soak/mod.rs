//! What a soak concludes from what it has seen: statistics in bounded memory, faults and recoveries,
//! budgets, the report. All of it is pure; `lookout soak` feeds it.

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
