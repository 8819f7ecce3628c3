//! `soak`: a mixed load on a daemon for minutes to hours, and whether what its worker takes stays flat.

use std::num::{NonZeroU16, NonZeroU32};
use std::time::Duration;

use clap::Args;
use pairmaskd::cli::machine::Machine;
use pairmaskd::cli::options::{CommonOptions, DaemonOptions};
use pairmaskd::cli::program::WrongUsage;
use pairmaskd::cli::progress::progress_bar;
use pairmaskd::cli::whole_number::whole_number;

use super::stress::ClientsDaemon;
use super::studies::Study;
use crate::Result;
use crate::processes::Daemon;
use crate::soak::{
    Growth, Probe, ProbeReport, Sample, Turnover, Verdict, Watch, growths, restarts,
};
use crate::stress::clients::{ClientSettings, ClientsRun, Pace};
use crate::stress::{Requested, StressReport, clock_seed};
use crate::study::harness::{Part, Report};

/// Sessions of every client: always as many, since what a worker takes varies with them.
const SESSIONS: u64 = 2;
/// Mean pause of a client between two steps. Ten clients, the probe and the daemon take about a
/// fifth of a core.
const PAUSE: Duration = Duration::from_millis(50);
/// A daemon of this run audits one frame in so many, some each second: each more would cost the load a core's time.
const AUDITED_ONE_IN: NonZeroU32 = NonZeroU32::new(50).expect("not zero");
/// Samples in the shortest run: two for each quarter.
const LEAST_SAMPLES: u64 = 8;

/// Keep a mixed load on a daemon, and see whether what it takes of the machine stays flat
#[derive(Debug, Args)]
#[command(after_help = "\
Client processes send frames of hard scenes in every form, edit persistent scenes and query them, and compare
all answers with a naive oracle, as those of `stress --clients` do, but at a pace. Each lives for 2 s to 3 min;
then one in three is killed and the others leave, and another one is started. Besides, one client of 1,000 moving
boxes stays and times its frames at 60 Hz.

Every few seconds a sample is taken of what the daemon's worker takes: resident memory, descriptors, mappings,
threads, and shared memory files. A quantity is flat where the median of the last quarter of its samples (of
latencies the tenth percentile, since other programs slow frames down) is no more than that of the second quarter
and a tolerance, which the table states as the limit; the first quarter warms up. Two hours notice a leak of
1 % a minute, ten minutes one of a descriptor for each session.

The daemon is started for the run and audits one frame in 50, or is a running one (--instance; it needs
--max-clients of 3 a client and 32 more), which no other client should use meanwhile. --out has all samples.

Examples:
  pairmask-lab soak --seconds 600 --gpu none
  pairmask-lab soak --clients 12 --out soak         soak.json, soak.csv and soak.md
  pairmask-lab soak --instance world --json

Exit status: 0 where no answer was wrong or lost, the worker was never restarted, and all is flat; else 1.")]
pub struct Soak {
    /// How long
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "7200")]
    seconds: NonZeroU32,
    /// Seconds from sample to sample
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "N", default_value = "10")]
    interval: NonZeroU32,
    /// Client processes at a time
    #[arg(long, value_parser = whole_number::<NonZeroU16>, value_name = "N", default_value = "6")]
    clients: NonZeroU16,
    /// Seed of the scenes, and of when clients end [default: from the clock]
    #[arg(long, value_parser = whole_number::<u64>, value_name = "N")]
    seed: Option<u64>,
    #[command(flatten)]
    options: DaemonOptions,
}

/// What a run has found.
struct Soaked {
    stress: StressReport,
    left: u64,
    samples: Vec<Sample>,
    growths: Vec<Growth>,
    probe: ProbeReport,
}

impl Study for Soak {
    fn measure(&self, common: &CommonOptions) -> Result<Report> {
        let least = LEAST_SAMPLES * u64::from(self.interval.get());
        if u64::from(self.seconds.get()) < least {
            let what = format!("--seconds has to be {least} at least, for {LEAST_SAMPLES} samples");
            return Err(WrongUsage(what).into());
        }
        let served = ClientsDaemon::new(self.clients, AUDITED_ONE_IN, &self.options, common)?;
        let daemon = Daemon::new(&served.dir, &served.instance, common.isa());
        Ok(self.run(daemon, Watch::new(&served.dir, &served.instance))?.report())
    }
}

impl Soak {
    fn run(&self, daemon: Daemon, mut watch: Watch) -> Result<Soaked> {
        let seed = self.seed.unwrap_or_else(clock_seed);
        let threads = std::thread::available_parallelism().map_or(1, usize::from);
        let all = vec!["all".to_owned()];
        let probe = Probe::start(daemon.session())?;
        let run = ClientsRun {
            clients: self.clients,
            daemon,
            settings: ClientSettings {
                seed,
                case: None,
                requested: Requested { engines: all.clone(), modes: all, threads },
                with_gpu: false,
                is_abrupt: true,
                pace: Some(Pace { sessions: SESSIONS, pause: PAUSE }),
            },
            time: Duration::from_secs(self.seconds.get().into()),
            // A fault at the beginning does not end the search for leaks.
            most_failures: usize::MAX,
            replay: format!("pairmask-lab stress --clients {} --seconds 60", self.clients),
        };
        let interval = Duration::from_secs(self.interval.get().into());
        let mut turnover = Turnover::new(self.clients.get().into(), seed);
        let mut samples = Vec::new();
        let mut probe_report = ProbeReport::default();
        let bar = progress_bar(self.seconds.get().into(), "soak");
        let stress = run.run(|crowd, time| {
            turnover.turn(crowd)?;
            if time < interval * (samples.len() as u32 + 1) {
                return Ok(());
            }
            let probed = probe.take();
            let sample = watch.sample(time, &probed);
            let line = format!("{} answers, {}", crowd.answers(), sample.line());
            bar.set_position(time.as_secs());
            bar.set_message(line);
            samples.push(sample);
            probe_report.add(probed);
            Ok(())
        })?;
        bar.finish_and_clear();
        probe_report.add(probe.take());
        let (left, growths) = (turnover.asked_to_end(), growths(&samples));
        Ok(Soaked { stress, left, samples, growths, probe: probe_report })
    }
}

impl Soaked {
    fn fault(&self) -> Option<&'static str> {
        let is_served = self.probe.lost == 0 && restarts(&self.samples) == 0;
        if !(self.stress.is_clean() && is_served) {
            let unsound = "answers were wrong or lost, or clients, daemon or audit were not as they should be";
            return Some(unsound);
        }
        let is_flat = self.growths.iter().all(|growth| growth.verdict == Verdict::Flat);
        (!is_flat).then_some("what the worker takes grew, or was not measured")
    }

    fn report(self) -> Report {
        let machine = Machine::this();
        let mut report = Report::new("soak", vec![Part::heading(1, "Soak")]);
        report.parts.push(Part::text(machine.to_string()));
        report.parts.push(Part::text(self.stress.to_string()));
        let restarts = restarts(&self.samples);
        let ProbeReport { frames, lost, why } = &self.probe;
        let why = why.as_ref().map_or(String::new(), |why| format!(" (the last: {why})"));
        let left = self.left;
        report.parts.push(Part::text(format!(
            "{left} clients were asked to end; the probe sent {frames} frames, lost {lost}{why}; {restarts} restarts"
        )));
        report.value("machine", &machine);
        report.value("stress", &self.stress);
        report.value("left", left);
        report.value("probe", &self.probe);
        report.value("restarts", restarts);
        report.section("quantities", "What the worker takes", "", &self.growths);
        report.list("samples", &self.samples);
        report.fault = self.fault();
        report
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::stress::clients::ClientsReport;

    #[test]
    fn whatever_was_wrong_lost_or_grew_is_a_fault() {
        let mut clients = ClientsReport::default();
        clients.daemon.serves = true;
        let clean = || Soaked {
            stress: StressReport {
                answers: 9,
                clients: Some(clients.clone()),
                ..StressReport::default()
            },
            left: 3,
            samples: vec![Sample { worker_pid: Some(7), ..Sample::default() }; 2],
            growths: vec![Growth {
                quantity: "threads",
                verdict: Verdict::Flat,
                second_quarter: Some(9),
                last_quarter: Some(9),
                limit: Some(11),
            }],
            probe: ProbeReport { frames: 9, ..ProbeReport::default() },
        };
        assert_eq!(clean().fault(), None);
        let spoils: [fn(&mut Soaked); 7] = [
            |soaked| soaked.stress.answers = 0,
            |soaked| soaked.stress.clients.as_mut().expect("clients").counts.unanswered = 1,
            |soaked| soaked.stress.clients.as_mut().expect("clients").daemon.serves = false,
            |soaked| soaked.probe.lost = 1,
            |soaked| soaked.samples[1].worker_pid = Some(8),
            |soaked| soaked.growths[0].verdict = Verdict::Grew,
            |soaked| soaked.growths[0].verdict = Verdict::NotMeasured,
        ];
        for (number, spoil) in spoils.into_iter().enumerate() {
            let mut soaked = clean();
            spoil(&mut soaked);
            assert!(soaked.report().fault.is_some(), "{number}");
        }
    }
}
