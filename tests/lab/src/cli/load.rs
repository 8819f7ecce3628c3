//! `load`: latency of clients at a pace, several at a time or of differing sizes: processes that start
//! together, while this process reads what the daemon uses. One file, because the command and its client
//! processes are two ends of one protocol.

use std::num::{NonZeroU32, NonZeroUsize};
use std::path::PathBuf;
use std::sync::mpsc::{Receiver, channel};
use std::thread::sleep;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask::{Backend, SessionBuilder};
use pairmask_core::BoxCount;
use pairmask_core::spinner::Spinner;
use pairmaskd::cli::bench::{CpuUsed, Figures, FramesOf, LatencyRow, SEED, Wait};
use pairmaskd::cli::machine::Machine;
use pairmaskd::cli::object_files::BoxFile;
use pairmaskd::cli::options::CommonOptions;
use pairmaskd::cli::program::WrongUsage;
use pairmaskd::cli::progress::spinner;
use pairmaskd::cli::target::{DEADLINE, Target};
use pairmaskd::cli::whole_number::whole_number;
use pairmaskd::daemon_cpu::DaemonCpu;
use pairmaskd::percentiles::Recorder;
use pairmaskd::precision::PrecisionChoice;
use pairmaskd::scene::{Scene, SceneName};
use pairmaskd::timed_client::{Decoding, TimedClient};
use serde::{Deserialize, Serialize};

use super::studies::Study;
use crate::Result;
use crate::processes::{Daemon, Work, Worker, is_reported_to_begin, report};
use crate::study::harness::{Fields, Part, Report, Table, fields, row};

/// The highest rate, Hz: a frame every 10 µs, which is shorter than any frame.
const MOST_HERTZ: u32 = 100_000;
/// The most clients at a time: each is a process, and takes a slot of the daemon.
const MOST_CLIENTS: u32 = 256;
/// Share of the time by which clients warm up, and the least, ms: 36 frames at 60 Hz show the pace.
const WARM_UP_SHARE: u32 = 5;
const LEAST_WARM_UP_MS: u32 = 600;
/// A daemon counts as idle this long after its last frame: a GPU's clocks are kept up for 0.25 s.
const SETTLE: Duration = Duration::from_millis(500);
/// How long an idle daemon is watched. The kernel counts in ticks of 10 ms, which are 0.5 % of it.
const IDLE_WINDOW: Duration = Duration::from_secs(2);
/// A paced client is awake this long before a frame is due: a sleeping thread wakes up to 0.1 ms late
/// on a virtual machine, and a game that has just moved its boxes is awake.
const AWAKE_BEFORE: Duration = Duration::from_micros(300);

/// Latency of frames of clients at a pace, several at a time or of differing sizes
#[derive(Debug, Args)]
#[command(after_help = "\
Clients are processes that start together, each with a session and a moving scene of its own. The stages of
a frame are those of `pairmaskd bench latency`. A frame of a paced client is due at its time, and `from due`
counts from then: after a stall, the frames that were due meanwhile count their waiting too. Each row says
what the daemon used of a core, and the last table what it uses while its clients send nothing.

Examples:
  pairmask-lab load --rate closed,60,240,1000 --n 1000,10000
  pairmask-lab load --clients 1,2,4,8 --n 1000 --instance world
  pairmask-lab load --mix 1000x7,1000000x1 --seconds 10")]
pub struct Load {
    #[command(flatten)]
    frames_of: FramesOf,
    /// Frames a second of each client, due at their times regardless of what became of those before; `closed`
    /// sends each when the one before is done
    #[arg(long, value_parser = rate, value_name = "HZ,..", value_delimiter = ',', default_value = "closed")]
    rate: Vec<Rate>,
    /// Client processes at a time, each with a session of its own
    #[arg(long, value_parser = client_count, value_name = "N,..", value_delimiter = ',', default_values_t = [1])]
    clients: Vec<u32>,
    /// Clients of differing sizes at a time: boxes x clients; one row each
    #[arg(long, value_parser = group, value_name = "NxCLIENTS,..", value_delimiter = ',', conflicts_with_all = ["n", "scene", "clients"])]
    mix: Vec<Group>,
    /// Seconds that are measured
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "3")]
    seconds: NonZeroU32,
    /// How clients and daemon wait for each other: spin, event, or serve, as they do by themselves
    #[arg(long, value_name = "HOW,..", value_delimiter = ',', default_values_t = [Wait::Serve])]
    wait: Vec<Wait>,
}

/// Frames a second; `None` is a closed loop.
type Rate = Option<NonZeroU32>;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Group {
    n: u32,
    clients: u32,
}

/// A number from 1 to `most`, in digits alone.
fn number(text: &str, most: u32, what: &str) -> Result<NonZeroU32, String> {
    let number = whole_number::<NonZeroU32>(text).ok();
    let number = number.filter(|n| n.get() <= most && !text.starts_with('+'));
    number.ok_or_else(|| format!("must be a whole number of {what} from 1 to {most}"))
}

fn client_count(text: &str) -> Result<u32, String> {
    number(text, MOST_CLIENTS, "clients").map(NonZeroU32::get)
}

fn rate(text: &str) -> Result<Rate, String> {
    if text == "closed" {
        return Ok(None);
    }
    number(text, MOST_HERTZ, "Hz").map(Some).map_err(|wrong| format!("{wrong}, or closed"))
}

fn group(text: &str) -> Result<Group, String> {
    let parts = text.split_once('x').and_then(|(n, clients)| {
        Some(Group { n: whole_number::<u32>(n).ok()?, clients: client_count(clients).ok()? })
    });
    parts.ok_or_else(|| {
        "must be boxes x clients, such as 1000x7 for seven clients of 1,000 boxes".to_owned()
    })
}

const NO_FRAME: &str = "no frame began within the measured time: give more --seconds";

const COLUMNS: &str = "n,backend,wait,engine,precision,rate,clients,clients_in_all,frames_per_second,\
    late_frames,from_due_ns.p99,total_ns.p50,total_ns.p99,round_trip_ns.p50,round_trip_ns.p99,\
    worst_client_p50_ns,daemon_cpu_percent";

#[derive(Clone, Debug, Serialize, Deserialize)]
pub(crate) struct ClientSettings {
    backend: String,
    engine: String,
    encoding: String,
    threads: Option<usize>,
    n: u32,
    scene: Option<PathBuf>,
    /// Which of the clients this is: each has a scene of its own.
    index: u32,
    rate: Rate,
    precision: String,
    wait: Wait,
    decode_threads: NonZeroUsize,
    warm_up_ms: u32,
    seconds: NonZeroU32,
}

/// What a client reports: first that it is ready, then its frames; or why it failed.
type Said = Result<Option<Box<Paced>>, String>;

/// Frames of a client, or of several of one size.
#[derive(Debug, Serialize, Deserialize)]
struct Paced {
    figures: Figures,
    frames_per_second: f64,
    late_frames: u64,
    from_due: Recorder,
}

impl Study for Load {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let clients = all_of(&self.mix);
        if clients > MOST_CLIENTS {
            let most = format!("leave some out, {MOST_CLIENTS} are the most");
            return Err(WrongUsage(format!("--mix has {clients} clients: {most}")).into());
        }
        let sizes = match &self.frames_of.scene {
            Some(path) => vec![u32::try_from(BoxFile::open(path)?.count()).unwrap_or(u32::MAX)],
            None => self.frames_of.n.clone(),
        };
        // The clients that run together: a mix, or every number of clients of every size.
        let alike = sizes.iter().flat_map(|n| self.clients.iter().map(|c| (*n, *c)));
        let groups: Vec<Vec<Group>> = if self.mix.is_empty() {
            alike.map(|(n, clients)| vec![Group { n, clients }]).collect()
        } else {
            vec![self.mix.clone()]
        };
        let mut runs = Vec::new();
        for rate in &self.rate {
            for groups in &groups {
                let precisions = self.frames_of.precision.iter();
                runs.extend(precisions.map(|precision| (*rate, &groups[..], *precision)));
            }
        }
        let _spinner = spinner("measuring");
        let (mut rows, mut idle) = (Vec::new(), Vec::new());
        for wait in &self.wait {
            self.run((&mut rows, &mut idle), *wait, &runs, common)?;
        }
        let machine = Machine::this();
        let mut report = Report::new("load", vec![Part::heading(1, "Load")]);
        report.parts.push(Part::text(machine.to_string()));
        report.value("machine", &machine);
        report.parts.extend(Part::section("Frames", "", Table::of(&rows).only(COLUMNS)));
        report.list("rows", &rows);
        if !idle.is_empty() {
            report.section("idle", "Clients that send nothing", "", &idle);
        }
        Ok(report)
    }
}

impl Load {
    fn run(
        &self,
        (rows, idle): (&mut Vec<Fields>, &mut Vec<Fields>),
        wait: Wait,
        runs: &[(Rate, &[Group], PrecisionChoice)],
        common: &CommonOptions,
    ) -> Result<()> {
        let most = runs.iter().map(|(_, groups, _)| all_of(groups)).max().unwrap_or(1);
        let (options, threads) = (&self.frames_of.options, self.frames_of.decode_threads.get());
        let target = Target::new(options, &self.frames_of.daemon, wait.spin(), most, common)?;
        let at = Daemon::new(&target.dir, &target.instance, common.isa());
        let cull = options.cull_options(common);
        let warm_up_ms = self.seconds.get().saturating_mul(1000) / WARM_UP_SHARE;
        for (i, (rate, groups, precision)) in runs.iter().enumerate() {
            let settings = ClientSettings {
                backend: options.backend(common, Backend::Daemon).to_string(),
                engine: cull.engine.to_string(),
                encoding: cull.encoding.to_string(),
                threads: cull.threads,
                n: 0,
                scene: self.frames_of.scene.clone(),
                index: 0,
                rate: *rate,
                precision: precision.to_string(),
                wait,
                decode_threads: self.frames_of.decode_threads,
                warm_up_ms: warm_up_ms.max(LEAST_WARM_UP_MS),
                seconds: self.seconds,
            };
            let cpu = target.cpu();
            // What the daemon uses of a core; `None` where none serves.
            let watch = |window: Duration| {
                let used = cpu.as_ref().map(DaemonCpu::watch);
                sleep(window);
                used.map(|used| used())
            };
            let sizes = groups.iter().flat_map(|g| std::iter::repeat_n(g.n, g.clients as usize));
            let mut clients: Vec<(Worker, Receiver<Option<Said>>)> = Vec::new();
            for (index, n) in (0..).zip(sizes) {
                let work = Work::Load(ClientSettings { n, index, ..settings.clone() });
                let (received, ears) = channel();
                // Nobody reads what a client reports after the run.
                clients.push((at.start(&work, move |said| drop(received.send(said)))?, ears));
            }
            for (_, ears) in &clients {
                next_report(ears)?;
            }
            for (client, _) in &mut clients {
                client.begin();
            }
            sleep(Duration::from_millis(settings.warm_up_ms.into()));
            let used = watch(Duration::from_secs(settings.seconds.get().into()));
            let done = |(_, ears): &(Worker, Receiver<Option<Said>>)| {
                next_report(ears)?.ok_or_else(|| NO_FRAME.into())
            };
            let measured = clients.iter().map(done).collect::<Result<Vec<_>>>()?;
            let clients_in_all = all_of(groups);
            if i + 1 == runs.len() {
                // While the clients stay connected.
                sleep(SETTLE);
                idle.extend(watch(IDLE_WINDOW).map(|used| {
                    let daemon_cpu_percent = used.percent();
                    row!(wait: wait.to_string(), clients: clients_in_all, daemon_cpu_percent)
                }));
            }
            for (client, _) in &mut clients {
                client.end();
            }
            let frames = measured.iter().map(|client| client.figures.frames).sum();
            let cpu = CpuUsed { daemon: used, client: None, frames };
            let mut measured = measured.into_iter();
            for Group { n, clients } in *groups {
                // The figures of all clients of a group as one, and the median round trip of the worst of them.
                let mut sum = measured.next().ok_or(NO_FRAME)?;
                let mut worst_client_p50_ns = sum.figures.round_trip_p50();
                for other in measured.by_ref().take(*clients as usize - 1) {
                    worst_client_p50_ns = worst_client_p50_ns.max(other.figures.round_trip_p50());
                    sum.figures.add(&other.figures)?;
                    sum.frames_per_second += other.frames_per_second;
                    sum.late_frames += other.late_frames;
                    sum.from_due.add(&other.from_due);
                }
                let latency = LatencyRow {
                    n: *n,
                    precision: *precision,
                    wait,
                    decode_threads: threads,
                    figures: sum.figures,
                    cpu,
                };
                let mut row = fields(&latency);
                row.extend(row!(
                    rate: rate.map_or("closed".to_owned(), |hertz| hertz.to_string()),
                    clients,
                    clients_in_all,
                    frames_per_second: (sum.frames_per_second * 10.0).round() / 10.0,
                    worst_client_p50_ns,
                    late_frames: sum.late_frames,
                    from_due_ns: sum.from_due.percentiles(),
                ));
                rows.push(row);
            }
        }
        Ok(())
    }
}

fn all_of(groups: &[Group]) -> u32 {
    groups.iter().map(|group| group.clients).sum()
}

fn next_report(ears: &Receiver<Option<Said>>) -> Result<Option<Box<Paced>>> {
    let said = ears.recv().ok().flatten();
    let said = said.unwrap_or_else(|| Err("it ended without a report".to_owned()));
    said.map_err(|why| format!("a client process failed: {why}").into())
}

impl ClientSettings {
    /// Connects, says so, waits for the start, measures, reports the figures, and stays connected until
    /// stdin ends. A failure is asked to the parent, which says why the measurement failed.
    pub(crate) fn run(&self, builder: SessionBuilder) {
        if let Some(measured) = self.measure(builder).transpose() {
            let said: Said = measured.map(Some).map_err(|error| error.to_string());
            report(&said);
            is_reported_to_begin();
        }
    }

    /// `None` where the parent gave up before the start.
    fn measure(&self, mut builder: SessionBuilder) -> Result<Option<Box<Paced>>> {
        // Names that the parent has written.
        let precision = self.precision.parse().unwrap_or(PrecisionChoice::Exact);
        let seed = SEED + u64::from(self.index);
        let mut scene = match &self.scene {
            Some(path) => Scene::from_boxes(BoxFile::open(path)?.read()?, seed),
            None => Scene::new(SceneName::Uniform, self.n as usize, seed),
        };
        let n = u32::try_from(scene.boxes().len()).unwrap_or(u32::MAX);
        if let Some(threads) = self.threads {
            builder = builder.threads(threads);
        }
        let session = builder
            .backend(self.backend.parse().unwrap_or(Backend::Daemon))
            .engine(self.engine.parse().unwrap_or_default())
            .encoding(self.encoding.parse().unwrap_or_default())
            .answer_repeats(false)
            .spin(self.wait.spin())
            .deadline(DEADLINE)
            .capacity(BoxCount::new(n))
            .iterate_threads(self.decode_threads.get())
            .connect()?;
        let decoding = Decoding::start(self.decode_threads)?;
        let mut client = TimedClient::new(session, precision, scene.boxes());
        // The backend of this frame has to serve all frames. It touches all memory too.
        let first = client.frame(scene.boxes(), &decoding, |_| ());
        let mut figures = Figures::of(&first?.info);
        report(&Said::Ok(None));
        if !is_reported_to_begin() {
            return Ok(None);
        }
        let (mut late_frames, mut from_due) = (0, Recorder::default());
        let start = Instant::now();
        let from = start + Duration::from_millis(self.warm_up_ms.into());
        let until = from + Duration::from_secs(self.seconds.get().into());
        let mut last_done = from;
        for frame in 0.. {
            scene.step();
            let asked = Instant::now();
            let due = self.rate.map(|hertz| start + due(frame, hertz));
            let begins = due.unwrap_or(asked);
            if begins >= until {
                break;
            }
            if let Some(nap) = begins.saturating_duration_since(asked).checked_sub(AWAKE_BEFORE) {
                sleep(nap);
            }
            let mut spinner = Spinner::default();
            while Instant::now() < begins {
                spinner.turn();
            }
            let times = client.frame(scene.boxes(), &decoding, |_| ())?;
            if begins < from {
                continue;
            }
            last_done = Instant::now();
            figures.record(&times)?;
            if due.is_some() {
                from_due.record(last_done.saturating_duration_since(begins).as_nanos() as u64);
                late_frames += u64::from(asked > begins);
            }
        }
        // A client whose frames take longer than the measurement counts to the end of its last one.
        let elapsed = (until - from).max(last_done - from);
        if figures.frames == 0 {
            return Err(NO_FRAME.into());
        }
        let frames_per_second = figures.frames as f64 / elapsed.as_secs_f64();
        Ok(Some(Box::new(Paced { figures, frames_per_second, late_frames, from_due })))
    }
}

/// When a frame is due after the first one: counted from its own beginning, one stall of many periods would appear as
/// a single slow frame (coordinated omission). Computed from the first frame on: rounding does not add up.
fn due(frame: u64, hertz: NonZeroU32) -> Duration {
    let ns = u128::from(frame) * 1_000_000_000 / u128::from(hertz.get());
    Duration::from_nanos(u64::try_from(ns).unwrap_or(u64::MAX))
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    #[test]
    fn rates_counts_and_mixes_are_whole_numbers_within_bounds() {
        assert_eq!(rate("100000"), Ok(NonZeroU32::new(100_000)));
        for text in ["0", "-1", "+60", "59.94", "100001", "60Hz", "4294967296", "open"] {
            assert!(rate(text).is_err(), "{text}");
        }
        assert!(client_count("256") == Ok(256) && client_count("257").is_err());
        assert_eq!(group("1000x7"), Ok(Group { n: 1000, clients: 7 }));
        assert_eq!(group("0x1"), Ok(Group { n: 0, clients: 1 }));
        for text in ["", "x", "1000", "1000x", "x7", "1000x0", "-1x1", "1000x7x1", "4294967296x1"] {
            assert!(group(text).is_err(), "{text}");
        }
        // Frames are due at multiples of the period, without drift.
        let hertz = |hertz| NonZeroU32::new(hertz).unwrap();
        assert_eq!(due(0, hertz(7)), Duration::ZERO);
        assert_eq!(due(60 * 3600, hertz(60)), Duration::from_secs(3600));
        assert_eq!(due(1, hertz(60)), Duration::from_nanos(16_666_666));
    }
}
