//! Cost of passing a message between processes: the daemon's transport, a bare eventfd, bare datagrams (the transport
//! notifies with named ones), and a copy of a pair of 640 × 480 through a Unix socket, all measured in one run.
//!
//! ```sh
//! cargo bench -p lookout-ipc                       # 1000 messages of each kind, 100 a second
//! cargo bench -p lookout-ipc -- --fifo --count 5000
//! ```
//!
//! Sender and receiver are two processes, on two cores if the machine has them. A time runs from just before the
//! message is sent until the awake receiver has it. Processor time is the sum of both processes. Machines stall, so
//! compare figures of one run, and medians rather than tails.

use lookout_ipc::bus::Bus;
use lookout_ipc::clock::{monotonic_ns, process_cpu_ns};
use lookout_ipc::header::{Header, Kind};
use lookout_ipc::instance::{Instance, InstanceLock};
use lookout_ipc::privilege::set_fifo;
use lookout_ipc::service::PAIR;
use lookout_ipc::wait::{self, Next};
use rustix::event::{EventfdFlags, PollFd, PollFlags, eventfd, poll};
use rustix::thread::{CpuSet, sched_getaffinity, sched_setaffinity};
use std::error::Error;
use std::io::{BufRead, BufReader, Write};
use std::os::unix::net::{UnixDatagram, UnixStream};
use std::path::Path;
use std::process::{Child, Command, Stdio};
use std::time::Duration;

const WIDTH: usize = 640;
const HEIGHT: usize = 480;
const PAIR_BYTES: usize = 2 * WIDTH * HEIGHT;
const NAME: &str = "bench";
const PRIORITY: u32 = 50;

type Outcome<T> = Result<T, Box<dyn Error>>;

#[derive(Clone, Copy)]
struct Options {
    count: usize,
    period: Duration,
    fifo: bool,
}

fn main() -> Outcome<()> {
    let arguments: Vec<String> = std::env::args().skip(1).collect();
    let value = |name: &str, default: u64| -> Outcome<u64> {
        match arguments.iter().position(|a| a == name) {
            Some(place) => Ok(arguments.get(place + 1).ok_or("a number is missing")?.parse()?),
            None => Ok(default),
        }
    };
    let options = Options {
        count: value("--count", 1000)? as usize,
        period: Duration::from_secs_f64(1.0 / value("--hz", 100)?.max(1) as f64),
        fifo: arguments.iter().any(|a| a == "--fifo"),
    };
    if let Some(place) = arguments.iter().position(|a| a == "--receive") {
        let argument = |i: usize| arguments.get(place + i).map(String::as_str).unwrap_or_default();
        return receive(argument(1), Path::new(argument(2)), options);
    }
    if arguments.iter().any(|a| a == "--help") {
        println!("cargo bench -p lookout-ipc -- [--count N] [--hz N] [--fifo]");
        return Ok(());
    }
    send_all(options)
}

/// Pins the process to a core, and sets its priority with `--fifo`.
fn enter_realtime(is_receiver: bool, options: Options) -> Outcome<()> {
    let allowed = sched_getaffinity(None)?;
    let mut cores = (0..CpuSet::MAX_CPU).filter(|&c| allowed.is_set(c));
    let (first, second) = (cores.next(), cores.next());
    if let Some(core) = if is_receiver { second.or(first) } else { first } {
        let mut set = CpuSet::new();
        set.set(core);
        sched_setaffinity(None, &set)?;
    }
    if options.fifo {
        set_fifo(PRIORITY).map_err(|e| format!("--fifo: {e}"))?;
    }
    Ok(())
}

// ---- receiver

fn receive(kind: &str, folder: &Path, options: Options) -> Outcome<()> {
    enter_realtime(true, options)?;
    let mut times = Vec::with_capacity(options.count);
    let ready = || -> Outcome<u64> {
        println!("ready");
        std::io::stdout().flush()?;
        Ok(process_cpu_ns())
    };
    let cpu_before = match kind {
        "bus" => {
            let bus = Bus::join(&Instance::new(NAME, folder))?;
            let subscriber = bus.subscriber(&PAIR)?;
            let before = ready()?;
            wait::run::<Box<dyn Error>>(&[&subscriber], || {
                while let Some(sample) = subscriber.receive()? {
                    times.push(monotonic_ns());
                    // The last message ends the run, even if earlier ones were overtaken.
                    if sample.header().sequence + 1 >= options.count as u64 {
                        return Ok(Next::Stop);
                    }
                }
                Ok(Next::Wait(Duration::from_secs(5)))
            })?;
            before
        }
        "eventfd" => {
            let before = ready()?;
            for _ in 0..options.count {
                rustix::io::read(std::io::stdin(), &mut [0_u8; 8])?;
                times.push(monotonic_ns());
            }
            before
        }
        "polled" => {
            let stdin = std::io::stdin();
            let mut descriptors = [PollFd::new(&stdin, PollFlags::IN)];
            let before = ready()?;
            for _ in 0..options.count {
                poll(&mut descriptors, None)?;
                times.push(monotonic_ns());
                rustix::io::read(&stdin, &mut [0_u8; 8])?;
            }
            before
        }
        "socket" => {
            let mut pair = vec![0_u8; PAIR_BYTES];
            let before = ready()?;
            for _ in 0..options.count {
                // Standard input is the socket; it is read directly, without the buffer of `Stdin`.
                let mut filled = 0;
                while filled < PAIR_BYTES {
                    match rustix::io::read(std::io::stdin(), &mut pair[filled..])? {
                        0 => return Err("the sender is gone".into()),
                        length => filled += length,
                    }
                }
                times.push(monotonic_ns());
            }
            before
        }
        other => return Err(format!("--receive {other}").into()),
    };
    let cpu_ns = process_cpu_ns() - cpu_before;
    let mut out = std::io::stdout().lock();
    writeln!(out, "{cpu_ns}")?;
    for time in times {
        writeln!(out, "{time}")?;
    }
    Ok(())
}

// ---- sender

struct Figures {
    p50_us: f64,
    p99_us: f64,
    cpu_us: f64,
    received: usize,
}

fn send_all(options: Options) -> Outcome<()> {
    let folder = tempfile::tempdir()?;
    let instance = Instance::new(NAME, folder.path());
    let _lock = InstanceLock::take(&instance)?;
    let (publish_us, receive_us) = own_part(&instance)?;
    enter_realtime(false, options)?;

    let bus = Bus::join(&instance)?;
    let publisher = bus.publisher(&PAIR, WIDTH, HEIGHT)?;
    let mut rows = Vec::new();
    for (name, bytes) in [("transport, 64 B", 64), ("transport, a pair", PAIR_BYTES)] {
        let child = start("bus", folder.path(), options, Stdio::null())?;
        let figures = measure(child, options, |sequence| {
            let mut loan = publisher.loan(bytes)?;
            *loan.header_mut() = Header::new(Kind::Pair);
            loan.header_mut().sequence = sequence;
            Ok(publisher.send(loan)?)
        })?;
        bus.sweep();
        rows.push((name, figures));
    }
    for (name, kind) in [("bare eventfd, read", "eventfd"), ("bare eventfd, polled", "polled")] {
        let event = eventfd(0, EventfdFlags::SEMAPHORE | EventfdFlags::CLOEXEC)?;
        let child = start(kind, folder.path(), options, Stdio::from(event.try_clone()?))?;
        let figures = measure(child, options, |_| {
            rustix::io::write(&event, &1_u64.to_ne_bytes())?;
            Ok(())
        })?;
        rows.push((name, figures));
    }
    let (near, far) = UnixDatagram::pair()?;
    let child = start("polled", folder.path(), options, Stdio::from(std::os::fd::OwnedFd::from(far)))?;
    rows.push(("bare datagram, polled", measure(child, options, |_| Ok(near.send(&[7]).map(drop)?))?));
    let path = folder.path().join("datagrams");
    let named = UnixDatagram::bind(&path)?;
    let sender = UnixDatagram::unbound()?;
    let child = start("polled", folder.path(), options, Stdio::from(std::os::fd::OwnedFd::from(named)))?;
    rows.push((
        "named datagram, polled",
        measure(child, options, |_| Ok(sender.send_to(&[7], &path).map(drop)?))?,
    ));
    let (mut near, far) = UnixStream::pair()?;
    let child = start("socket", folder.path(), options, Stdio::from(std::os::fd::OwnedFd::from(far)))?;
    let pair = vec![7_u8; PAIR_BYTES];
    let figures = measure(child, options, |_| Ok(near.write_all(&pair)?))?;
    rows.push(("Unix socket, a pair copied", figures));

    let rate = 1.0 / options.period.as_secs_f64();
    println!("{} messages of each kind, {rate:.0} a second, fifo {}", options.count, options.fifo);
    println!("{:<28} {:>10} {:>10} {:>14} {:>9}", "", "p50 us", "p99 us", "CPU us/message", "received");
    for (name, f) in &rows {
        println!("{name:<28} {:>10.1} {:>10.1} {:>14.1} {:>9}", f.p50_us, f.p99_us, f.cpu_us, f.received);
    }
    println!(
        "transport within one awake process: publish {publish_us:.2} us, receive {receive_us:.2} us (medians)"
    );
    let against = |row: usize| rows[1].1.p50_us / rows[row].1.p50_us;
    println!(
        "passing a pair takes {:.2} times as long as a bare eventfd that is read, {:.2} times one that is polled, {:.2} times a named datagram (medians)",
        against(2),
        against(3),
        against(5)
    );
    Ok(())
}

/// Median time of loan, send and notify, and of receive, in µs, with publisher and subscriber in this process, awake.
fn own_part(instance: &Instance) -> Outcome<(f64, f64)> {
    let bus = Bus::join(instance)?;
    let publisher = bus.publisher(&PAIR, WIDTH, HEIGHT)?;
    let subscriber = bus.subscriber(&PAIR)?;
    let (mut publish, mut receive) = (Vec::new(), Vec::new());
    for _ in 0..20_000 {
        let begin = monotonic_ns();
        let mut loan = publisher.loan(PAIR_BYTES)?;
        *loan.header_mut() = Header::new(Kind::Pair);
        publisher.send(loan)?;
        let sent = monotonic_ns();
        let got = subscriber.receive()?;
        let end = monotonic_ns();
        assert!(got.is_some(), "the message has arrived");
        drop(got);
        publish.push(sent - begin);
        receive.push(end - sent);
    }
    Ok((percentile_us(&mut publish, 0.5), percentile_us(&mut receive, 0.5)))
}

fn start(kind: &str, folder: &Path, options: Options, stdin: Stdio) -> Outcome<Child> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(["--receive", kind]).arg(folder).args(["--count", &options.count.to_string()]);
    if options.fifo {
        command.arg("--fifo");
    }
    Ok(command.stdin(stdin).stdout(Stdio::piped()).spawn()?)
}

/// Sends all messages to a receiver that is ready, and combines its times with those of the sender.
fn measure(mut child: Child, options: Options, mut send: impl FnMut(u64) -> Outcome<()>) -> Outcome<Figures> {
    let mut lines = BufReader::new(child.stdout.take().ok_or("no output")?).lines();
    if lines.next().transpose()?.as_deref() != Some("ready") {
        return Err("the receiver did not get ready".into());
    }
    // The receiver has to be asleep when the first message arrives.
    std::thread::sleep(Duration::from_millis(100));
    let mut sent = Vec::with_capacity(options.count);
    let cpu_before = process_cpu_ns();
    for sequence in 0..options.count as u64 {
        std::thread::sleep(options.period);
        sent.push(monotonic_ns());
        send(sequence)?;
    }
    let own_ns = process_cpu_ns() - cpu_before;
    let mut numbers = Vec::new();
    for line in lines {
        numbers.push(line?.parse::<u64>()?);
    }
    child.wait()?;
    let (cpu_ns, times) = numbers.split_first().ok_or("the receiver died")?;
    // A received message is the last one that was sent before it: others may have been overtaken.
    let mut taken: Vec<u64> = times
        .iter()
        .filter_map(|time| Some(time - sent[sent.partition_point(|s| s <= time).checked_sub(1)?]))
        .collect();
    Ok(Figures {
        p50_us: percentile_us(&mut taken, 0.5),
        p99_us: percentile_us(&mut taken, 0.99),
        cpu_us: (own_ns + cpu_ns) as f64 * 1e-3 / options.count as f64,
        received: taken.len(),
    })
}

fn percentile_us(times_ns: &mut [u64], share: f64) -> f64 {
    times_ns.sort_unstable();
    let place = ((times_ns.len() as f64 * share) as usize).min(times_ns.len().saturating_sub(1));
    times_ns.get(place).map_or(0.0, |&ns| ns as f64 * 1e-3)
}
