//! `lookout calibrate --live`: pairs are taken from what runs, and kept when they say something new.

use super::arguments::Calibrate;
use crate::command::attach::attach;
use crate::command::config_args::load;
use crate::command::error::CommandError;
use crate::input;
use config::Config;
use messages::wait::{self, Next};
use messages::{pair, service};
use perception::calibration::Board;
use perception::image::GreyView;
use signal_hook::consts::{SIGHUP, SIGINT, SIGTERM};
use sources::{PairSource, Readiness};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::{Duration, Instant};
use tools::calibration::live::{Session, Step};
use tools::reporting::picture::save_grey;

/// How long a source may be silent.
const PATIENCE: Duration = Duration::from_secs(20);

/// The same is not said more often.
const TALK_PERIOD: Duration = Duration::from_secs(2);

/// Keeps pairs until they suffice, the source ends or the user stops it. Gives the folder with the kept
/// pictures, from which the calibration is then made as from any other.
pub fn collect(args: &Calibrate, board: Board, log: Option<&str>) -> Result<PathBuf, CommandError> {
    let mut config = load(&args.config, log, "calibrate", Some("warn"))?;
    let folder = args.pictures.clone().unwrap_or_else(|| args.out.with_extension("pictures"));
    for side in ["left", "right"] {
        let part = folder.join(side);
        let fail = |e: std::io::Error| CommandError::Other(format!("{}: {e}", part.display()));
        std::fs::create_dir_all(&part).map_err(fail)?;
        if std::fs::read_dir(&part).map_err(fail)?.next().is_some() {
            return Err(CommandError::Other(format!(
                "{}: holds pictures already: remove them, or name another folder with --pictures",
                part.display()
            )));
        }
    }
    let stop = Arc::new(AtomicBool::new(false));
    for signal in [SIGINT, SIGTERM, SIGHUP] {
        signal_hook::flag::register(signal, Arc::clone(&stop))
            .map_err(|e| CommandError::Other(format!("cannot catch signals: {e}")))?;
    }
    let mut keeper = Keeper { args, board, folder: folder.clone(), session: None, said: None };
    match &args.dir {
        None => from_daemon(&config, &mut keeper, &stop)?,
        Some(path) => {
            choose(&mut config, path);
            from_source(&config, &mut keeper, &stop)?;
        }
    }
    let kept = keeper.session.as_ref().map_or(0, Session::kept);
    if kept == 0 {
        return Err(CommandError::Other(
            "no pair was kept: the board was never at rest in both pictures; check --board, the light, and that \
             both cameras see the whole board"
                .into(),
        ));
    }
    eprintln!("{kept} pairs kept in {}", folder.display());
    Ok(folder)
}

/// The source that a path names.
fn choose(config: &mut Config, path: &Path) {
    // As the cameras took them.
    config.source.rectify = false;
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
        }
    }
}

fn from_source(config: &Config, keeper: &mut Keeper<'_>, stop: &AtomicBool) -> Result<(), CommandError> {
    let mut source = input::open(config).map_err(|e| CommandError::Other(e.to_string()))?;
    let size = source.size();
    let (mut left, mut right) = (vec![0; size.0 * size.1], vec![0; size.0 * size.1]);
    // Pictures of a folder are each of another moment.
    let needs_rest = config.source.kind != "folder";
    let count = source.count().unwrap_or(u64::MAX);
    let mut heard = Instant::now();
    let mut index = 0;
    while index < count && !stop.load(Ordering::Relaxed) {
        if !await_pair(source.as_mut(), &mut heard)? {
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

/// Whether a pair can be read; cameras have to be waited for.
fn await_pair(source: &mut dyn PairSource, heard: &mut Instant) -> Result<bool, CommandError> {
    let Some(live) = source.live() else { return Ok(true) };
    match live.wait(Duration::from_millis(100)) {
        Readiness::Pair { .. } => {
            *heard = Instant::now();
            return Ok(true);
        }
        Readiness::Trouble(text) => eprintln!("{text}"),
        Readiness::Nothing | Readiness::Recovered => {}
    }
    if heard.elapsed() > PATIENCE {
        return Err(CommandError::Other(format!("no pairs come: nothing for {} s", PATIENCE.as_secs())));
    }
    Ok(false)
}

fn from_daemon(config: &Config, keeper: &mut Keeper<'_>, stop: &AtomicBool) -> Result<(), CommandError> {
    let attached = attach(config, "calibrate --live")?;
    let pairs = attached.bus.subscriber(&service::PAIR)?;
    let mut heard = Instant::now();
    let mut images: (Vec<u8>, Vec<u8>) = Default::default();
    wait::run::<CommandError>(&[&pairs], || {
        let mut size = None;
        if let Some(sample) = pairs.receive()?
            && let Ok(pair) = pair::view(sample.header(), sample.payload())
        {
            // Looking for boards takes longer than a message may be held.
            images.0.clear();
            images.0.extend_from_slice(pair.left);
            images.1.clear();
            images.1.extend_from_slice(pair.right);
            size = Some((sample.header().width as usize, sample.header().height as usize));
        }
        if let Some(size) = size {
            heard = Instant::now();
            if keeper.offer(&images.0, &images.1, size, true)? {
                return Ok(Next::Stop);
            }
        }
        if stop.load(Ordering::Relaxed) || attached.stop.load(Ordering::Relaxed) {
            return Ok(Next::Stop);
        }
        if heard.elapsed() > PATIENCE || !attached.instance.is_running() {
            return Ok(Next::Stop);
        }
        Ok(Next::Wait(Duration::from_millis(200)))
    })
}

/// Keeps pictures and talks to the user.
struct Keeper<'a> {
    args: &'a Calibrate,
    board: Board,
    folder: PathBuf,
    session: Option<Session>,
    said: Option<(String, Instant)>,
}

impl Keeper<'_> {
    /// Looks at a pair. Gives whether no more are needed.
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
            Step::NoBoard => self.say("no board in both pictures"),
            Step::Moving => self.say("hold the board still"),
            Step::Known => self.say("this view is known: move or tilt the board"),
            Step::Kept { verdict, dropped } => {
                let path =
                    |side: &str, number: usize| self.folder.join(side).join(format!("{number:04}.png"));
                save_grey(&path("left", number), left, width, height)?;
                save_grey(&path("right", number), right, width, height)?;
                for &number in &dropped {
                    for path in [path("left", number), path("right", number)] {
                        std::fs::remove_file(&path)
                            .map_err(|e| CommandError::Other(format!("{}: {e}", path.display())))?;
                    }
                }
                self.said = None;
                match verdict {
                    None => self.say(&format!("pair {number} kept")),
                    Some(verdict) => {
                        let missing = verdict.reasons.first().map_or("", |r| r.text.as_str());
                        let more = if is_complete { "enough" } else { missing };
                        self.say(&format!("pair {number} kept: {} so far; {more}", verdict.grade));
                    }
                }
                for number in dropped {
                    eprintln!(
                        "pair {number} dropped: the board moved between its exposures; show it there again, at rest"
                    );
                }
            }
        }
        Ok(is_complete)
    }

    /// Says something, but not the same again and again.
    fn say(&mut self, text: &str) {
        let is_old = |(said, at): &(String, Instant)| said == text || at.elapsed() < TALK_PERIOD;
        if self.said.as_ref().is_some_and(is_old) {
            return;
        }
        self.said = Some((text.to_owned(), Instant::now()));
        eprintln!("{text}");
    }
}
