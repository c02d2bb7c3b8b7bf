//! What people look at: pictures, plots, records of frames, summaries of runs and scores against
//! truth.

pub mod calibrate;
pub mod colour;
pub mod compare;
pub mod evaluate;
pub mod output;
pub mod overlay;
pub mod picture;
pub mod plot;
pub mod ply;
pub mod record;
pub mod recording;
pub mod soak;
pub mod summary;
pub mod svg;
pub mod train;
pub mod v_disparity;
