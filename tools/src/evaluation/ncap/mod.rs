//! Evaluation by the standard tests: rules, table and page. The scenes are [`sources::scene::ncap`].

pub mod page;
pub mod report;
pub mod rules;
