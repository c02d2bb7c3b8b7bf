//! What people look at: pictures, plots, records of frames and summaries of runs.

pub mod colour;
pub mod output;
pub mod overlay;
pub mod picture;
pub mod plot;
pub mod record;
pub mod summary;
pub mod v_disparity;
