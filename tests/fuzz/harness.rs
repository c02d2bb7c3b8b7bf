//! Runs a parser on mutated inputs in a process of its own, so that every failure is detected: a panic, an abort, an
//! input that takes too long, an allocation out of proportion to the input.
//!
//! `LOOKOUT_FUZZ_SECONDS` is the time for each target (2 by default, for every commit),
//! `LOOKOUT_FUZZ_SEED` the seed (1 by default, `clock` for another every time). There is no coverage
//! feedback; the parser's answer replaces it: an input with a new answer joins the corpus.
//!
//! [`fuzz`] mutates bytes of given inputs. [`fuzz_format`] has a generator of valid inputs and changes that keep their
//! structure; at least a tenth of its inputs must be accepted, or the reader's depths are not reached.

use super::mutate::mutate;
use crate::support::turns;
use fastrand::Rng;
use rustix::process::{Resource, Rlimit, getrlimit, setrlimit};
use std::collections::HashSet;
use std::fs::File;
use std::io::Write;
use std::os::unix::fs::FileExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Marks the child process, and names the folder for its input.
const CHILD: &str = "LOOKOUT_FUZZ_CHILD";

/// Processor time that one input may take: a thousand times what it should.
const MAX_CPU_NS: u64 = 10_000_000_000;

/// Memory that a reader may take beyond what the process has.
const MAX_BYTES: u64 = 256 << 20;

/// Bytes of an answer, at most: no error repeats its input.
const MAX_ANSWER: usize = 64 << 10;

/// Inputs of the corpus, at most.
const MAX_INPUTS: usize = 2000;

/// Least share of inputs of a format that its reader accepts: one of so many.
const ACCEPTED_ONE_IN: u64 = 10;

/// A format with its generator.
pub struct Format<'a> {
    /// The path of the calling test below the module `fuzz`.
    pub name: &'a str,
    /// Bytes of the longest input.
    pub longest: usize,
    /// Makes a valid input, each time another.
    pub generate: &'a mut dyn FnMut(&mut Rng) -> Vec<u8>,
    /// Changes an input but keeps its structure; may take parts of another one.
    pub change: fn(&mut Rng, &mut Vec<u8>, &[u8]),
}

/// Fuzzes the reader of a format: `Ok` is an input that it accepts, `Err` the text of its error.
pub fn fuzz_format(format: Format<'_>, mut read: impl FnMut(&[u8], &Path) -> Result<String, String>) {
    let Format { name, longest, generate, change } = format;
    let Some(folder) = std::env::var_os(CHILD) else { return parent(name) };
    let mut next = |_: u64, random: &mut Rng, corpus: &[Vec<u8>]| {
        let own = |random: &mut Rng| corpus[random.usize(0..corpus.len())].clone();
        let kind = if corpus.is_empty() { 0 } else { random.u8(0..10) };
        let mut input = match kind {
            0..=2 => generate(random),
            // Valid inputs with one change each, and those of the corpus with one more.
            3..=6 => {
                let mut input = if random.bool() { generate(random) } else { own(random) };
                let other = own(random);
                for _ in 0..1 + random.usize(0..3) {
                    change(random, &mut input, &other);
                }
                input
            }
            // Without new ones a small corpus would stay small.
            7 => {
                let new = [generate(random), own(random)];
                mutate(random, &new, longest)
            }
            _ => mutate(random, corpus, longest),
        };
        input.truncate(longest);
        input
    };
    let (runs, accepted) =
        child(name, Path::new(&folder), &mut next, &mut |input, path| match read(input, path) {
            Ok(answer) => (true, answer),
            Err(error) => (false, error),
        });
    assert!(
        accepted * ACCEPTED_ONE_IN >= runs,
        "{accepted} of {runs} inputs were accepted: the generator and the reader do not agree"
    );
}

/// Fuzzes a reader: it is called with inputs and returns a text about each. `name` is the path of the calling test
/// below the module `fuzz`.
pub fn fuzz(name: &str, seeds: Vec<Vec<u8>>, longest: usize, mut read: impl FnMut(&[u8], &Path) -> String) {
    assert!(!seeds.is_empty() && seeds.iter().any(|s| !s.is_empty()));
    if let Some(folder) = std::env::var_os(CHILD) {
        let mut next = |run: u64, random: &mut Rng, corpus: &[Vec<u8>]| match seeds.get(run as usize) {
            // As they are, first.
            Some(seed) => seed.clone(),
            None if random.u8(0..4) == 0 => mutate(random, &seeds, longest),
            None => mutate(random, corpus, longest),
        };
        let mut answer = |input: &[u8], path: &Path| {
            let answer = read(input, path);
            (answer.starts_with("ok"), answer)
        };
        child(name, Path::new(&folder), &mut next, &mut answer);
        return;
    }
    parent(name);
}

/// Runs the calling test once more in a process of its own, and prints its figures.
fn parent(name: &str) {
    let _turn = turns::beside_others();
    let folder = tempfile::tempdir().expect("a folder");
    let mut process = Command::new(std::env::current_exe().expect("this program"))
        .args(["--exact", &test_path(name), "--nocapture", "--test-threads=1"])
        .env(CHILD, folder.path())
        // A backtrace takes longer than a run.
        .env("RUST_BACKTRACE", "0")
        .stdout(Stdio::piped())
        .spawn()
        .expect("the child starts");
    let start = Instant::now();
    let most = Duration::from_secs(seconds() + 120);
    let status = loop {
        if let Some(status) = process.try_wait().expect("the child can be waited for") {
            break status;
        }
        if start.elapsed() > most {
            let _ = process.kill();
            let _ = process.wait();
            panic!("an input never ended: {}", keep(name, folder.path()));
        }
        std::thread::sleep(Duration::from_millis(20));
    };
    let output = process.wait_with_output().expect("its output");
    let text = String::from_utf8_lossy(&output.stdout);
    assert!(status.success(), "{status}: {}\n{text}", keep(name, folder.path()));
    // The test's own line begins before it.
    let figures =
        text.find(&format!("fuzz {name}: ")).map(|at| text[at..].lines().next().unwrap_or_default());
    println!("{}", figures.unwrap_or_else(|| panic!("the child did not run {name}:\n{text}")));
}

/// The name that libtest gives a test of the module `fuzz`, wherever that stands in this program.
fn test_path(name: &str) -> String {
    let (_, path) = module_path!().split_once("::").expect("the name of the program comes first");
    let (fuzz, _) = path.rsplit_once("::").expect("this module comes last");
    format!("{fuzz}::{name}")
}

/// Whether this process is the one that runs the reader.
pub fn is_child() -> bool {
    std::env::var_os(CHILD).is_some()
}

fn seconds() -> u64 {
    std::env::var("LOOKOUT_FUZZ_SECONDS").map_or(2, |s| s.parse().expect("LOOKOUT_FUZZ_SECONDS is a number"))
}

fn seed() -> u64 {
    match std::env::var("LOOKOUT_FUZZ_SEED").as_deref() {
        Ok("clock") => fastrand::u64(..),
        Ok(text) => text.parse().expect("LOOKOUT_FUZZ_SEED is a number or clock"),
        Err(_) => 1,
    }
}

/// Keeps the input that broke the reader.
fn keep(name: &str, folder: &Path) -> String {
    let kept = std::env::temp_dir().join(format!("fuzz-{name}"));
    match std::fs::copy(folder.join("input"), &kept) {
        Ok(bytes) => format!("the input of {bytes} bytes is kept in {}: make it a test", kept.display()),
        Err(error) => format!("the input could not be kept: {error}"),
    }
}

/// Makes the next input from the number of the run and the corpus.
type Next<'a> = &'a mut dyn FnMut(u64, &mut Rng, &[Vec<u8>]) -> Vec<u8>;

/// Reads an input: whether it is accepted, and what was said.
type Read<'a> = &'a mut dyn FnMut(&[u8], &Path) -> (bool, String);

/// Gives the number of inputs, and of those that were accepted.
fn child(name: &str, folder: &Path, next: Next<'_>, read: Read<'_>) -> (u64, u64) {
    let seed = seed();
    limit_memory();
    let input_file = File::create(folder.join("input")).expect("the file of the input");
    let path = folder.join("read");
    let mut random = Rng::with_seed(seed);
    let (mut seen, mut corpus) = ([HashSet::new(), HashSet::new()], Vec::new());
    let (mut runs, mut accepted, mut slowest_ns) = (0_u64, 0_u64, 0);
    let until = Instant::now() + Duration::from_secs(seconds());
    while Instant::now() < until {
        let input = next(runs, &mut random, &corpus);
        // On disk before it is read: whatever happens, it is known.
        input_file.set_len(0).expect("the input is written");
        input_file.write_all_at(&input, 0).expect("the input is written");
        let before = messages::clock::process_cpu_ns();
        let (is_accepted, answer) = read(&input, &path);
        let taken_ns = messages::clock::process_cpu_ns() - before;
        slowest_ns = slowest_ns.max(taken_ns);
        assert!(taken_ns < MAX_CPU_NS, "an input of {} bytes took {} ms", input.len(), taken_ns / 1_000_000);
        assert!(answer.len() < MAX_ANSWER, "a text of {} bytes on {} bytes", answer.len(), input.len());
        // An error's bulk is no reason to keep its input more than once.
        if seen[usize::from(is_accepted)].insert(shape(&answer)) && corpus.len() < MAX_INPUTS {
            corpus.push(input);
        }
        runs += 1;
        accepted += u64::from(is_accepted);
    }
    println!(
        "fuzz {name}: seed {seed}, {runs} inputs, {accepted} accepted with {} different answers, {} others with {} \
         different answers, slowest {:.1} ms",
        seen[1].len(),
        runs - accepted,
        seen[0].len(),
        slowest_ns as f64 * 1e-6
    );
    std::io::stdout().flush().expect("standard output");
    (runs, accepted)
}

/// An answer without its figures and names, so that each kind of fault counts once.
fn shape(answer: &str) -> String {
    let mut shape: String =
        answer.chars().map(|c| if c.is_ascii_digit() { '0' } else { c }).take(120).collect();
    while shape.contains("00") {
        shape = shape.replace("00", "0");
    }
    shape
}

/// An allocation out of proportion ends the child.
fn limit_memory() {
    let status = std::fs::read_to_string("/proc/self/status").expect("/proc/self/status");
    let line = status.lines().find_map(|l| l.strip_prefix("VmSize:")).expect("VmSize");
    let now: u64 = line.trim().trim_end_matches(" kB").parse().expect("a number of kB");
    let limit = Rlimit { current: Some(now * 1024 + MAX_BYTES), maximum: getrlimit(Resource::As).maximum };
    setrlimit(Resource::As, limit).expect("the limit of memory");
}

/// Files of the project below a folder with an ending, as inputs.
pub fn files(folder: &str, ending: &str) -> Vec<Vec<u8>> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..").join(folder);
    let mut paths: Vec<PathBuf> = std::fs::read_dir(&root)
        .unwrap_or_else(|e| panic!("{}: {e}", root.display()))
        .flatten()
        .map(|entry| entry.path())
        .filter(|path| path.extension().is_some_and(|e| e == ending))
        .collect();
    paths.sort();
    paths.iter().map(|path| std::fs::read(path).expect("a file of the project")).collect()
}

/// Writes an input to a file for a reader that takes paths.
pub fn written(path: &Path, ending: &str, input: &[u8]) -> PathBuf {
    let path = path.with_extension(ending);
    std::fs::write(&path, input).expect("the input is written");
    path
}
