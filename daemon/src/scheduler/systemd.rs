//! The run as a systemd service: notifications and reload.

use super::notify::View;
use super::reload;
use super::run::{Phase, Run};
use crate::stages;
use config::Config;
use messages::pipeline::Role;
use messages::status::StatusRecord;
use std::sync::atomic::Ordering;

impl Run {
    /// Sends the notifications that are due.
    pub(super) fn notify(&mut self, now: u64) {
        let view = View {
            has_result: self.collector.results() > 0,
            has_pair: self.credit.has_pair(),
            // The watchdog must not restart the daemon because the writer was given up.
            all_live: self.supervisor.frames_pass(),
            is_stopping: self.phase != Phase::Running,
        };
        self.notify.step(now, view);
    }

    /// Sends the state of the daemon to systemd.
    pub(super) fn notify_status(&mut self, status: &StatusRecord, now: u64) {
        let state = format!("{} {}", status.state_name(), status.reason());
        let hottest = self.board.hottest();
        self.notify.status(now, state.trim_end(), || {
            let reason = status.reason();
            let because = if reason.is_empty() { String::new() } else { format!(" ({reason})") };
            let rate_hz =
                status.processes().find(|(role, _)| *role == Role::LAST).map_or(0.0, |(_, p)| p.rate_hz);
            let heat = hottest.map_or(String::new(), |at| format!(", {at}"));
            format!(
                "{}{because}: {rate_hz:.1} frames a second, {:.0} ms end to end, {} obstacles{heat}",
                status.state_name(),
                status.latency_p50_ms,
                status.obstacles
            )
        });
    }

    /// Whether SIGHUP has arrived since the last call.
    pub fn takes_reload(&self) -> bool {
        self.hangup.swap(false, Ordering::Relaxed) && self.phase == Phase::Running
    }

    /// Reads and applies the configuration. An error is logged, and the old configuration stays in use.
    pub fn reload(&mut self, read: impl FnOnce() -> Result<Config, String>, now: u64) {
        self.notify.reloading();
        match read().and_then(|new| self.take_over(new, now)) {
            Ok(text) => {
                tracing::info!("{text}");
                self.notify.reloaded(&text);
            }
            Err(reason) => {
                let text = format!("the configuration was read again and refused: {reason}");
                tracing::error!("{text}");
                self.notify.reloaded(&text);
            }
        }
    }

    fn take_over(&mut self, new: Config, now: u64) -> Result<String, String> {
        let plan = reload::plan(&self.launch.config, &new).map_err(|refused| refused.to_string())?;
        if plan.keys.is_empty() {
            return Ok("the configuration was read again: nothing has changed".into());
        }
        // The new configuration has to be usable before any stage is stopped.
        stages::check(&new, &self.launch.frames).map_err(|error| error.to_string())?;
        if plan.board {
            self.board.reload(&new).map_err(|error| error.to_string())?;
        }
        crate::logging::set_level(&new.log.level);
        self.launch.config = new;
        for role in plan.roles {
            if let Some(action) = self.supervisor.renew(role, now) {
                self.act(action, now);
            }
        }
        Ok(format!("the configuration was read again; changed: {}", plan.keys.join(", ")))
    }
}
