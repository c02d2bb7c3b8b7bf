//! `lookout calibrate --live`: selects pairs from a live source that show the board in new views.

use super::arguments::Calibrate;
use crate::command::attach::{attach, stop_on_signals};
use crate::command::config_args::load;
use crate::command::error::CommandError;
use crate::input;
use config::Config;
use config::automatic::Automatic;
use messages::instance::InstanceError;
use messages::wait::{self, Next};
use messages::{pair, service};
use perception::calibration::Board;
use perception::image::GreyView;
use sources::{PairSource, Readiness};
use std::io::ErrorKind;
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::calibration::live::{Session, Step};
use tools::reporting::picture::save_grey;

/// A source without pairs for this long is an error.
const TIMEOUT: Duration = Duration::from_secs(20);

/// A source without pairs for this long is told.
const PATIENCE: Duration = Duration::from_secs(2);

/// Shortest time between two different messages to the user.
const MESSAGE_PERIOD: Duration = Duration::from_secs(2);

/// Selects pairs until they suffice, the source ends or the user stops it. Returns the folder with the
/// selected pictures; the calibration then reads it like any other folder.
pub fn collect(args: &Calibrate, board: Board, log: Option<&str>) -> Result<PathBuf, CommandError> {
    let mut config = load(&args.config, log, "calibrate", Some("warn"))?;
    let folder = args.pictures.clone().unwrap_or_else(|| args.out.with_extension("pictures"));
    for side in ["left", "right"] {
        check_empty(&folder.join(side))?;
    }
    let stop = stop_on_signals()?;
    let mut keeper = Keeper { args, board, folder: folder.clone(), session: None, last_message: None };
    match &args.dir {
        None => from_daemon(&config, &mut keeper, &stop)?,
        Some(path) => {
            set_source(&mut config, path);
            from_source(&config, &mut keeper, &stop)?;
        }
    }
    let kept = keeper.session.as_ref().map_or(0, Session::kept);
    if keeper.session.is_none() {
        let remedy = match (&args.dir, config.source.kind.as_str()) {
            (None, _) => "lookout status says whether its source gives pairs",
            (Some(_), "camera") => "lookout doctor says whether the cameras answer, and what to do",
            _ => "give a recording with pairs of the board",
        };
        return Err(CommandError::Other(format!("ended before the first pair: {remedy}")));
    }
    if kept == 0 {
        return Err(CommandError::Other(
            "no pair was selected: the board was never detected at rest in both pictures; check --pattern, \
             --board, the light, and that both cameras see the board, a chessboard whole"
                .into(),
        ));
    }
    eprintln!("{kept} pairs kept in {}", folder.display());
    Ok(folder)
}

/// Checks that a folder has no files, or does not exist.
fn check_empty(folder: &Path) -> Result<(), CommandError> {
    let text = match std::fs::read_dir(folder) {
        Err(error) if error.kind() == ErrorKind::NotFound => return Ok(()),
        Err(error) => format!("{error}: give another folder with --pictures"),
        Ok(mut entries) => match entries.next() {
            None => return Ok(()),
            Some(_) => "is not empty: remove its pictures, or give another folder with --pictures".into(),
        },
    };
    Err(CommandError::Other(format!("{}: {text}", folder.display())))
}

/// Configures the source that a path names.
fn set_source(config: &mut Config, path: &Path) {
    // Calibration needs the unrectified images.
    config.source.rectify = Automatic::Off;
    config.source.repeat = false;
    match path.to_str() {
        Some("camera") => config.source.kind = "camera".into(),
        Some(text) if text.starts_with("scene:") => {
            config.source.kind = "scene".into();
            config.source.path = text["scene:".len()..].into();
        }
        _ => {
            let is_file = tools::evaluation::compare::is_recording(path);
            config.source.kind = if is_file { "recording" } else { "folder" }.into();
            config.source.path = path.to_owned();
            config.source.left = PathBuf::new();
            config.source.right = PathBuf::new();
        }
    }
}

fn from_source(config: &Config, keeper: &mut Keeper<'_>, stop: &AtomicBool) -> Result<(), CommandError> {
    let mut source = input::open(config).map_err(|e| CommandError::Other(e.to_string()))?;
    let size = source.size();
    let (mut left, mut right) = (vec![0; size.0 * size.1], vec![0; size.0 * size.1]);
    // Pictures of a folder are not a sequence, so motion cannot be measured between them.
    let needs_rest = config.source.kind != "folder";
    let count = source.count().unwrap_or(u64::MAX);
    let mut wait = Wait::new(match config.source.kind.as_str() {
        "camera" => format!("the cameras ({})", camera_names(config)),
        _ => "the source".to_owned(),
    });
    let mut index = 0;
    while index < count && !stop.load(Ordering::Relaxed) {
        if !await_pair(source.as_mut(), &mut wait)? {
            continue;
        }
        source.read(index, &mut left, &mut right)?;
        index += 1;
        if keeper.offer(&left, &right, size, needs_rest)? {
            break;
        }
    }
    Ok(())
}

/// The devices of the configuration, for texts.
fn camera_names(config: &Config) -> String {
    let [left, right] = [&config.camera.left, &config.camera.right].map(|path| path.display());
    if config.camera.side_by_side { left.to_string() } else { format!("{left}, {right}") }
}

/// How long nothing has come, and what was said of it.
struct Wait {
    /// What does not answer.
    what: String,
    since: Instant,
    told: bool,
    /// Why, as the source says.
    trouble: String,
}

impl Wait {
    fn new(what: String) -> Self {
        Self { what, since: Instant::now(), told: false, trouble: String::new() }
    }

    /// A pair has come.
    fn end(&mut self) {
        (self.since, self.told) = (Instant::now(), false);
        self.trouble.clear();
    }

    /// Says at once why nothing comes.
    fn explain(&mut self, trouble: String) {
        eprintln!("no pair yet from {}: {trouble}", self.what);
        (self.told, self.trouble) = (true, trouble);
    }

    /// Says after a moment that nothing comes.
    ///
    /// # Errors
    /// If that has lasted too long.
    fn check(&mut self) -> Result<(), CommandError> {
        let waited = self.since.elapsed();
        if waited > TIMEOUT {
            let seconds = TIMEOUT.as_secs();
            let because = if self.trouble.is_empty() { String::new() } else { format!(": {}", self.trouble) };
            return Err(CommandError::Other(format!("no pair from {} for {seconds} s{because}", self.what)));
        }
        if waited > PATIENCE && !self.told {
            self.told = true;
            eprintln!("no pair yet from {}: waiting", self.what);
        }
        Ok(())
    }
}

/// Waits for a live source; returns whether a pair can be read.
fn await_pair(source: &mut dyn PairSource, wait: &mut Wait) -> Result<bool, CommandError> {
    let Some(live) = source.live() else { return Ok(true) };
    match live.wait(Duration::from_millis(100)) {
        Readiness::Pair { .. } => {
            wait.end();
            return Ok(true);
        }
        Readiness::Trouble(text) => wait.explain(text),
        Readiness::Nothing | Readiness::Recovered => {}
    }
    wait.check()?;
    Ok(false)
}

fn from_daemon(config: &Config, keeper: &mut Keeper<'_>, stop: &AtomicBool) -> Result<(), CommandError> {
    let attached = attach(config, "calibrate --live").map_err(|error| match error {
        // lookout run would refuse cameras without a rig.
        CommandError::Instance(InstanceError::NotRunning { name, others }) => CommandError::Other(format!(
            "no daemon named \"{name}\" is running{others}: give --live camera to calibrate the cameras of the configuration (-c \
             FILE) without one, or name another with --instance"
        )),
        error => error,
    })?;
    let pairs = attached.bus.subscriber(&service::PAIR)?;
    let mut wait = Wait::new(format!("the daemon \"{}\"", attached.instance.name()));
    wait.trouble = "its source does not answer; lookout status says why".into();
    let mut images: (Vec<u8>, Vec<u8>) = Default::default();
    wait::run::<CommandError>(&[&pairs], || {
        let mut size = None;
        if let Some(sample) = pairs.receive()?
            && let Ok(pair) = pair::view(sample.header(), sample.payload())
        {
            // Copied, because board detection takes longer than a message may be held.
            images.0.clear();
            images.0.extend_from_slice(pair.left);
            images.1.clear();
            images.1.extend_from_slice(pair.right);
            size = Some((sample.header().width as usize, sample.header().height as usize));
        }
        if let Some(size) = size {
            wait.end();
            if keeper.offer(&images.0, &images.1, size, true)? {
                return Ok(Next::Stop);
            }
        }
        if stop.load(Ordering::Relaxed) || attached.stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if !attached.instance.is_running() {
            return Ok(Next::Stop);
        }
        // Pairs that were selected before count.
        match wait.check() {
            Err(_) if keeper.session.as_ref().is_some_and(|session| session.kept() > 0) => {
                return Ok(Next::Stop);
            }
            result => result?,
        }
        Ok(Next::Wait(Duration::from_millis(200)))
    })
}

/// Saves the selected pairs and guides the user.
struct Keeper<'a> {
    args: &'a Calibrate,
    board: Board,
    folder: PathBuf,
    session: Option<Session>,
    last_message: Option<(String, Instant)>,
}

impl Keeper<'_> {
    /// Offers a pair to the session and saves it if it was selected. Returns whether no more are needed.
    fn offer(
        &mut self,
        left: &[u8],
        right: &[u8],
        size: (usize, usize),
        needs_rest: bool,
    ) -> Result<bool, CommandError> {
        let (lens, crop) = (self.args.lens.into(), self.args.crop.into());
        let board = self.board;
        let session = self.session.get_or_insert_with(|| Session::new(board, lens, crop, size, needs_rest));
        let (width, height) = size;
        let step = session
            .offer(GreyView::new(left, width, height, width)?, GreyView::new(right, width, height, width)?);
        let (number, is_complete) = (session.taken(), session.is_complete());
        match step {
            Step::NoBoard => self.report("board not detected in both pictures"),
            Step::Moving => self.report("hold the board still"),
            Step::Known => self.report("this view is known: move or tilt the board"),
            Step::Kept { verdict, dropped } => {
                let path =
                    |side: &str, number: usize| self.folder.join(side).join(format!("{number:04}.png"));
                for side in ["left", "right"] {
                    let part = self.folder.join(side);
                    std::fs::create_dir_all(&part)
                        .map_err(|e| CommandError::Other(format!("{}: {e}", part.display())))?;
                }
                save_grey(&path("left", number), left, width, height)?;
                save_grey(&path("right", number), right, width, height)?;
                for &number in &dropped {
                    for path in [path("left", number), path("right", number)] {
                        std::fs::remove_file(&path)
                            .map_err(|e| CommandError::Other(format!("{}: {e}", path.display())))?;
                    }
                }
                self.last_message = None;
                match verdict {
                    None => self.report(&format!("pair {number} kept")),
                    Some(verdict) => {
                        let missing = verdict.reasons.first().map_or("", |r| r.text.as_str());
                        let more = if is_complete { "enough" } else { missing };
                        self.report(&format!("pair {number} kept: {} so far; {more}", verdict.grade));
                    }
                }
                for number in dropped {
                    eprintln!(
                        "pair {number} removed: the board moved between its exposures; repeat this view at rest"
                    );
                }
            }
        }
        Ok(is_complete)
    }

    /// Prints a message, unless it repeats the last one or follows it too soon.
    fn report(&mut self, text: &str) {
        let suppresses = |(last, at): &(String, Instant)| last == text || at.elapsed() < MESSAGE_PERIOD;
        if self.last_message.as_ref().is_some_and(suppresses) {
            return;
        }
        self.last_message = Some((text.to_owned(), Instant::now()));
        eprintln!("{text}");
    }
}
