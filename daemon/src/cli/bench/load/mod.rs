//! Clients at a pace, several at a time, or of differing sizes: processes that start together, while
//! this process reads what the daemon uses.

mod asked;
mod client;
mod processes;
mod protocol;
mod schedule;

pub use self::asked::{AskedError, ClientCount, MixPart, Rate};
pub use self::client::BenchClient;

use std::num::NonZeroU32;
use std::process::Command;
use std::thread::sleep;
use std::time::Duration;

use clap::Args;

use self::processes::Clients;
use super::latency::BenchError;
use super::measured::Figures;
use crate::cli::daemon_cpu::DaemonCpu;
use crate::cli::output::spinner;
use crate::cli::whole_number::whole_number;

/// Measured time unless set: 180 frames at 60 Hz.
const DEFAULT_SECONDS: NonZeroU32 = NonZeroU32::new(3).expect("not zero");
/// Share of the measured time by which clients warm up, and the least, ms: 36 frames at 60 Hz, after
/// which both sides know a client's pace.
const WARM_UP_SHARE: u32 = 5;
const LEAST_WARM_UP_MS: u32 = 600;
/// A daemon counts as idle this long after its last frame: a GPU's clocks are kept up for 0.25 s.
const SETTLE: Duration = Duration::from_millis(500);
/// How long an idle daemon is watched. The kernel counts in ticks of 10 ms, which are 0.5 % of it.
const IDLE_WINDOW: Duration = Duration::from_secs(2);

/// Clients other than one in a closed loop.
#[derive(Clone, Debug, Args)]
pub struct LoadFlags {
    /// Frames a second of each client, due at their times whatever became of those before; `closed`
    /// sends each when the one before is done
    #[arg(long, value_name = "HZ,..", value_delimiter = ',', conflicts_with_all = ["frames", "warm_up", "pin"])]
    rate: Vec<Rate>,
    /// Client processes at a time, each with a session of its own
    #[arg(long, value_name = "N,..", value_delimiter = ',', conflicts_with_all = ["frames", "warm_up", "pin"])]
    clients: Vec<ClientCount>,
    /// Clients of differing sizes at a time: boxes x clients; one row each
    #[arg(long, value_name = "NxCLIENTS,..", value_delimiter = ',', conflicts_with_all = ["n", "scene", "clients", "frames", "warm_up", "pin"])]
    mix: Vec<MixPart>,
    /// Seconds that are measured with --rate, --clients or --mix [default: 3]
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", conflicts_with_all = ["frames", "warm_up"])]
    seconds: Option<NonZeroU32>,
}

/// Clients of one size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Group {
    /// Boxes of each; of no meaning with a scene of its own.
    pub n: u32,
    /// How many clients.
    pub clients: u32,
}

/// One measurement: all clients that run together.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Case {
    /// How each asks for its frames.
    pub rate: Rate,
    /// The clients by size.
    pub groups: Vec<Group>,
}

/// What the clients of one size measured.
#[derive(Debug)]
pub struct GroupFigures {
    /// Which clients.
    pub group: Group,
    /// All of them together.
    pub figures: Figures,
    /// The median round trip of the worst of them, ns.
    pub worst_p50_ns: u64,
}

/// What a case showed.
#[derive(Debug)]
pub struct CaseFigures {
    /// In the order of the case's groups.
    pub groups: Vec<GroupFigures>,
    /// What the daemon used of a core, percent; `None` where none serves.
    pub daemon_percent: Option<f64>,
    /// The same after the clients' last frame, while they stayed connected; `None` unless asked for.
    pub idle_percent: Option<f64>,
}

impl LoadFlags {
    /// Whether any other than one client in a closed loop is asked for.
    pub const fn is_asked(&self) -> bool {
        !(self.rate.is_empty() && self.clients.is_empty() && self.mix.is_empty())
    }

    /// Checks what the parser cannot.
    ///
    /// # Errors
    /// [`BenchError::Asked`], [`BenchError::SecondsAlone`].
    pub fn check(&self) -> Result<(), BenchError> {
        asked::clients_of(&self.mix)?;
        if self.seconds.is_some() && !self.is_asked() {
            return Err(BenchError::SecondsAlone);
        }
        Ok(())
    }

    /// The most clients at a time.
    pub fn most_clients(&self) -> u32 {
        let mixed = self.mix.iter().map(|part| part.clients.get()).sum();
        self.clients.iter().map(|count| count.get()).fold(mixed, u32::max).max(1)
    }

    /// The cases, for scenes of `sizes` where no mix is asked for.
    pub fn cases(&self, sizes: &[u32]) -> Vec<Case> {
        let rates = if self.rate.is_empty() { &[Rate::Closed][..] } else { &self.rate };
        let counts = if self.clients.is_empty() { &[ClientCount::ONE][..] } else { &self.clients };
        let group = |part: &MixPart| Group { n: part.n, clients: part.clients.get() };
        let together: Vec<Vec<Group>> = if self.mix.is_empty() {
            let alike = |n: &u32| {
                counts.iter().map(|count| vec![Group { n: *n, clients: count.get() }]).collect()
            };
            sizes.iter().flat_map::<Vec<_>, _>(alike).collect()
        } else {
            vec![self.mix.iter().map(group).collect()]
        };
        let at = |rate: &Rate| {
            let case = |groups: &Vec<Group>| Case { rate: *rate, groups: groups.clone() };
            together.iter().map(case).collect::<Vec<_>>()
        };
        rates.iter().flat_map(at).collect()
    }

    /// How long is measured.
    fn seconds(&self) -> NonZeroU32 {
        self.seconds.unwrap_or(DEFAULT_SECONDS)
    }

    fn warm_up_ms(&self) -> u32 {
        (self.seconds().get().saturating_mul(1000) / WARM_UP_SHARE).max(LEAST_WARM_UP_MS)
    }

    /// Runs a case. `client` makes the command of one client; the flags of the case are added to it.
    ///
    /// # Errors
    /// [`BenchError`]; no client is left running.
    pub fn run(
        &self,
        case: &Case,
        client: impl Fn() -> Result<Command, BenchError>,
        daemon: Option<&DaemonCpu>,
        with_idle: bool,
        what: &str,
    ) -> Result<CaseFigures, BenchError> {
        let progress = spinner(what);
        let sizes = case.groups.iter().flat_map(|g| std::iter::repeat_n(g.n, g.clients as usize));
        let commands: Result<Vec<Command>, BenchError> = sizes
            .enumerate()
            .map(|(index, n)| {
                let mut command = client()?;
                command
                    .args(["--n", &n.to_string()])
                    .args(["--index", &index.to_string()])
                    .args(["--rate", &case.rate.to_string()])
                    .args(["--warm-up-ms", &self.warm_up_ms().to_string()])
                    .args(["--seconds", &self.seconds().to_string()]);
                Ok(command)
            })
            .collect();
        let mut clients = Clients::start(commands?)?;
        clients.begin();
        sleep(Duration::from_millis(self.warm_up_ms().into()));
        let daemon_percent = watch(daemon, Duration::from_secs(self.seconds().get().into()));
        let figures = clients.figures()?;
        let idle_percent = if with_idle {
            sleep(SETTLE);
            watch(daemon, IDLE_WINDOW)
        } else {
            None
        };
        clients.end();
        progress.finish_and_clear();
        let mut figures = figures.into_iter();
        let groups: Result<Vec<GroupFigures>, BenchError> = case
            .groups
            .iter()
            .map(|group| together(*group, figures.by_ref().take(group.clients as usize)))
            .collect();
        Ok(CaseFigures { groups: groups?, daemon_percent, idle_percent })
    }
}

/// What the daemon uses of a core during the next `window`, percent.
fn watch(daemon: Option<&DaemonCpu>, window: Duration) -> Option<f64> {
    let since = daemon.map(DaemonCpu::since_now);
    sleep(window);
    daemon.zip(since).map(|(daemon, since)| daemon.percent(&since))
}

/// The figures of all clients of a group as one.
fn together(
    group: Group,
    figures: impl Iterator<Item = Figures>,
) -> Result<GroupFigures, BenchError> {
    let figures: Vec<Figures> = figures.collect();
    let p50 = |figures: &Figures| figures.stages.round_trip.percentiles().p50;
    let worst_p50_ns = figures.iter().map(p50).max().unwrap_or(0);
    let mut figures = figures.into_iter();
    let Some(mut sum) = figures.next() else {
        return Err(BenchError::Client { why: "there is none".to_owned() });
    };
    figures.try_for_each(|other| sum.add(&other))?;
    Ok(GroupFigures { group, figures: sum, worst_p50_ns })
}

#[cfg(test)]
#[allow(clippy::unwrap_used)]
mod tests {
    use super::*;

    fn flags(rate: &str, clients: &str, mix: &str) -> LoadFlags {
        fn list<T: std::str::FromStr<Err = AskedError>>(text: &str) -> Vec<T> {
            text.split(',').filter(|part| !part.is_empty()).map(|p| p.parse().unwrap()).collect()
        }
        LoadFlags { rate: list(rate), clients: list(clients), mix: list(mix), seconds: None }
    }

    #[test]
    fn a_case_for_every_rate_size_and_number_of_clients() {
        let flags = flags("closed,60", "1,4", "");
        let cases = flags.cases(&[10, 20]);
        let found: Vec<(String, u32, u32)> = cases
            .iter()
            .map(|case| (case.rate.to_string(), case.groups[0].n, case.groups[0].clients))
            .collect();
        let mut expected = Vec::new();
        for rate in ["closed", "60"] {
            for n in [10, 20] {
                expected.extend([(rate.to_owned(), n, 1), (rate.to_owned(), n, 4)]);
            }
        }
        assert_eq!(found, expected);
        assert!(cases.iter().all(|case| case.groups.len() == 1));
        assert_eq!(flags.most_clients(), 4);
    }

    #[test]
    fn the_parts_of_a_mix_run_together() {
        let flags = flags("240", "", "1000x7,1000000x1");
        let cases = flags.cases(&[10]);
        assert_eq!(cases.len(), 1);
        let (small, large) = (Group { n: 1000, clients: 7 }, Group { n: 1_000_000, clients: 1 });
        assert_eq!(cases[0].groups, [small, large]);
        assert_eq!(flags.most_clients(), 8);
        assert!(flags.check().is_ok() && flags.is_asked());
    }

    #[test]
    fn too_many_clients_of_a_mix_and_seconds_of_nothing_are_refused() {
        assert!(flags("", "", "1x256,2x256").check().is_err());
        let mut plain = flags("", "", "");
        assert!(plain.check().is_ok() && !plain.is_asked());
        plain.seconds = NonZeroU32::new(1);
        assert!(plain.check().is_err());
    }
}
