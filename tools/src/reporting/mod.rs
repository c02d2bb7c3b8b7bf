//! What people look at: pictures, plots, overlays, records of frames and summaries of runs.

pub mod colour;
pub mod output;
pub mod overlay;
pub mod picture;
pub mod plot;
pub mod ply;
pub mod record;
pub mod summary;
pub mod svg;
pub mod v_disparity;
