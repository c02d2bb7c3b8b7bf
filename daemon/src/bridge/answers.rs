//! Answers requests: for events, for the state, for a point cloud.

use super::camera::{Camera, Picture};
use super::feed::Events;
use super::keys::Keys;
use perception::point_cloud::{self, Point, PointCloudParameters};
use perception::rig::Rig;
use perception::stereo::DisparityView;
use serde_json::{Value, json};
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};
use tools::reporting::ply;
use zenoh::bytes::Encoding;
use zenoh::key_expr::KeyExpr;
use zenoh::query::{Query, Queryable};
use zenoh::{Session, Wait};

/// Number of requests that may wait; further ones get no answer.
const MAX_WAITING: usize = 64;

/// Longest wait for the next picture, and for the rig.
const CLOUD_TIMEOUT: Duration = Duration::from_secs(3);

/// Longest wait for a request, after which stopping is checked.
const WAIT: Duration = Duration::from_millis(250);

/// Step in columns and rows between two points of a cloud, unless the request names another; and the largest.
const STEP: usize = 2;
const MAX_STEP: usize = 64;

/// Answers requests.
pub struct Answers {
    events: Arc<Events>,
    camera: Option<Arc<Camera>>,
    state: Mutex<Value>,
    keys: Keys,
    sender: SyncSender<Query>,
}

impl Answers {
    /// With a camera also for point clouds. The requests come out of the receiver, for [`Self::run`].
    pub fn new(keys: Keys, events: Arc<Events>, camera: Option<Arc<Camera>>) -> (Self, Receiver<Query>) {
        let (sender, receiver) = sync_channel(MAX_WAITING);
        (Self { events, camera, state: Mutex::default(), keys, sender }, receiver)
    }

    /// Sets the state that requests get.
    pub fn set_state(&self, state: Value) {
        *self.state.lock().unwrap_or_else(PoisonError::into_inner) = state;
    }

    /// Receives requests of a session, as long as the result is held.
    ///
    /// # Errors
    /// If zenoh does not take a key.
    pub fn declare(&self, session: &Session, keys: &Keys) -> zenoh::Result<Vec<Queryable<()>>> {
        let mut wanted = vec![keys.events(), keys.topic("status")];
        wanted.extend(self.camera.is_some().then(|| keys.topic("cloud")));
        let declare = |key| {
            let sender = self.sender.clone();
            let take = move |query| {
                // A request that finds no place gets no answer.
                let _ = sender.try_send(query);
            };
            session.declare_queryable(key).callback(take).wait()
        };
        wanted.into_iter().map(declare).collect()
    }

    /// Answers requests until it is stopped.
    pub fn run(&self, requests: Receiver<Query>, stop: &AtomicBool) {
        while !stop.load(Ordering::Relaxed) {
            let Ok(query) = requests.recv_timeout(WAIT) else { continue };
            // Several vehicles may be asked at once, so keys are compared as expressions.
            self.answer_events(&query);
            if intersects(&query, &self.keys.topic("status")) {
                self.answer_state(&query);
            }
            if intersects(&query, &self.keys.topic("cloud")) {
                self.answer_cloud(&query);
            }
        }
    }

    /// The events, and their pictures where the request's key names them; with `?from=N` from the event N on.
    fn answer_events(&self, query: &Query) {
        let from = query.parameters().get("from").and_then(|text| text.parse().ok()).unwrap_or(0);
        let entries: Vec<_> = self.events.spool().entries().filter(|e| e.event >= from).cloned().collect();
        for entry in entries {
            let (key, encoding) = match entry.frame {
                None => (self.keys.event(entry.event), Encoding::APPLICATION_JSON),
                Some(frame) => (self.keys.picture(entry.event, frame), Encoding::IMAGE_JPEG),
            };
            if !intersects(query, &key) {
                continue;
            }
            let Ok(content) = self.events.spool().read(&entry) else { continue };
            reply(query, key, content, encoding);
        }
    }

    /// The state; with `?brief` what a list of vehicles shows.
    fn answer_state(&self, query: &Query) {
        let state = self.state.lock().unwrap_or_else(PoisonError::into_inner).clone();
        let shown = if query.parameters().contains_key("brief") { brief(&state) } else { state };
        reply(query, self.keys.topic("status"), shown.to_string().into_bytes(), Encoding::APPLICATION_JSON);
    }

    /// The point cloud of the next frame as a PLY file; `?step=N;max_m=D` limits it.
    fn answer_cloud(&self, query: &Query) {
        let Some(camera) = &self.camera else { return };
        let parameter = |name: &str| query.parameters().get(name).and_then(|text| text.parse::<f64>().ok());
        let default = PointCloudParameters::default();
        let parameters = PointCloudParameters {
            step: parameter("step").map_or(STEP, |step| (step as usize).clamp(1, MAX_STEP)),
            max_distance_m: parameter("max_m").filter(|m| *m > 0.0).unwrap_or(default.max_distance_m),
            ..default
        };
        match cloud(camera, &parameters) {
            Ok(file) => reply(query, self.keys.topic("cloud"), file, Encoding::APPLICATION_OCTET_STREAM),
            Err(why) => {
                let _ = query.reply_err(why).wait();
            }
        }
    }
}

fn cloud(camera: &Camera, parameters: &PointCloudParameters) -> Result<Vec<u8>, &'static str> {
    let (sender, receiver) = sync_channel(1);
    if !camera.request(sender) {
        return Err("too many requests: ask again later");
    }
    let picture: Picture =
        receiver.recv_timeout(CLOUD_TIMEOUT).map_err(|_| "no picture has come: is the daemon running?")?;
    let rig = rig(camera).ok_or("the rig is not known yet: ask again in a second")?;
    let (width, height) = (picture.size.0 as usize, picture.size.1 as usize);
    let map = DisparityView::new(&picture.disparity, width, height).ok_or("the picture has no map")?;
    let mut points: Vec<Point> = Vec::new();
    point_cloud::fill(map, &picture.left, &rig, parameters, &mut points);
    let mut file = Vec::new();
    ply::write(&mut file, &points, |point| [point[3] as u8; 3]).map_err(|_| "the cloud cannot be written")?;
    Ok(file)
}

/// The rig; a bridge that has just begun gets it with the next status.
fn rig(camera: &Camera) -> Option<Rig> {
    let begin = Instant::now();
    loop {
        let rig = camera.rig();
        if rig.is_some() || begin.elapsed() > CLOUD_TIMEOUT {
            return rig;
        }
        std::thread::sleep(WAIT);
    }
}

/// What a list of vehicles shows of a state.
fn brief(state: &Value) -> Value {
    let status = &state["status"];
    json!({
        "state": if status.is_null() { "no daemon".into() } else { status["state"].clone() },
        "reason": status["reason"],
        "alarm": status["alarm"],
        "alarm_reason": status["alarm_reason"],
        "version": state["bridge"]["version"],
        "events": state["bridge"]["events"],
        "events_lost": state["bridge"]["events_lost"],
    })
}

fn intersects(query: &Query, key: &str) -> bool {
    KeyExpr::try_from(key).is_ok_and(|key| query.key_expr().intersects(&key))
}

fn reply(query: &Query, key: String, content: Vec<u8>, encoding: Encoding) {
    if let Err(error) = query.reply(key, content).encoding(encoding).wait() {
        tracing::debug!(%error, "a request was not answered");
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_list_shows_state_alarm_and_version() {
        let state = json!({ "status": { "state": "running", "alarm": "clear", "reason": "" }, "bridge": { "version": "1" } });
        let brief_state = brief(&state);
        assert_eq!((&brief_state["state"], &brief_state["version"]), (&"running".into(), &"1".into()));
        assert_eq!(brief(&json!({ "status": null }))["state"], "no daemon");
    }

    #[test]
    fn a_cloud_needs_a_daemon() {
        let camera = Camera::new(0, Duration::ZERO);
        assert!(
            cloud(&camera, &PointCloudParameters::default()).unwrap_err().contains("is the daemon running")
        );
    }
}
