//! `replay`: the requests of a recording, sent again.

use std::fmt::Write;
use std::fs::File;
use std::io::{BufReader, Read};
use std::path::{Path, PathBuf};

use clap::Args;
use pairmask_core::EngineChoice;
use serde_json::{Value, json};

use super::machine::Machine;
use super::options::{CommonOptions, DaemonOptions};
use super::output::{is_stdout, print_json, print_text};
use super::program::{Result, WrongUsage};
use super::progress::spinner;
use super::target::Target;
use crate::file_error::{Access, FileError};
use crate::percentiles::{Percentiles, Recorder};
use crate::precision::PrecisionChoice;
use crate::recording::{ReadError, Recording};
use crate::replay::{Latencies, Pace, Player, Row, Tally, replay};
use crate::shown::Shown;

/// Send the requests of a recording again, and compare the answers
#[derive(Debug, Args)]
#[command(after_help = "\
`serve --record` makes recordings. Each request is answered before the next one is sent; every answer has to
have the pairs, changes or hits of the recorded one. An answer that differs is named, and the exit status is 1.

A daemon is started for the replay unless an instance is named. Times are those in the daemon, when it was
recorded and now, and the round trip now.

--in-process answers by the engines of this process. Shared scenes need a daemon: their requests are left out,
and counted.

--precision sends the frames of f32 boxes in less precision, and in a daemon of its own as recorded, too: they
must have all pairs of those, and how many they have more is counted. Scenes have no precision, and stay as
recorded.

Examples:
  pairmaskd replay game.pmrec
  pairmaskd replay game.pmrec --engine cpu-sap --json
  pairmaskd replay game.pmrec --compare cpu-brute    names the first pair that differs
  pairmaskd replay game.pmrec --in-process
  pairmaskd replay game.pmrec --precision q16        how many pairs cells of 16 bits add
  pairmaskd replay game.pmrec --pace --instance world")]
pub struct Replay {
    /// The recording, `-` for stdin
    file: PathBuf,
    /// Engine of all frames and scenes, auto for the plan's choice [default: as recorded]
    #[arg(long, value_name = "NAME")]
    engine: Option<EngineChoice>,
    /// Send all to this engine too, in a daemon of its own, and compare the answers pair by pair
    #[arg(long, value_name = "ENGINE")]
    compare: Option<EngineChoice>,
    /// Answer by the cores of this process: no daemon is asked
    #[arg(long)]
    in_process: bool,
    /// Send frames of f32 boxes in this precision: q16, q8, f16 or margin=X [default: as recorded]
    #[arg(long, value_name = "MODE", default_value_t, hide_default_value = true)]
    precision: PrecisionChoice,
    /// Send no request earlier than in the recording
    #[arg(long)]
    pace: bool,
    #[command(flatten)]
    daemon: DaemonOptions,
    /// Print one JSON object
    #[arg(long)]
    json: bool,
}

impl Replay {
    pub fn run(&self, common: &CommonOptions) -> Result {
        self.check(common)?;
        let name = self.file.display();
        let mut recording = open(&self.file)?;
        // Shared scenes have the same names: they are to meet in no daemon.
        let is_compared = self.compared().is_some();
        let (mut target, mut other) = (None, None);
        if !self.in_process {
            target = Some(Target::daemon(&self.daemon, common)?);
            other = is_compared.then(|| Target::private(&self.daemon, common)).transpose()?;
        }
        let player = |target: &Option<Target>| match target {
            Some(target) => Player::new(target.dir.clone(), target.instance.clone()),
            None => Player::in_process(common.isa()),
        };
        let first = player(&target).with_engine(self.engine).with_precision(self.precision);
        let mut players = vec![first];
        if is_compared {
            let engine = self.compare.or(self.engine);
            players = vec![
                players.remove(0).keeping_entries(),
                player(&other).with_engine(engine).keeping_entries(),
            ];
        }
        let pace = if self.pace { Pace::Recorded } else { Pace::Fast };
        let progress = spinner(&format!("replaying {name}"));
        let tally = replay(&mut recording, &mut players, pace)
            .map_err(|error| format!("{name}: {error}"))?;
        progress.finish_and_clear();
        if let Some(why) = &tally.ends_early {
            log::warn!("{name}: {why}: what comes before it is replayed");
        }
        if tally.cut_sessions > 0 {
            let count = tally.cut_sessions;
            log::warn!(
                "{name}: {count} sessions were recorded in part; shared scenes may miss them"
            );
        }
        if tally.skipped() > 0 && tally.skipped() == tally.requests() {
            let what = "all of it is of shared scenes, which need a daemon: leave --in-process out";
            return Err(format!("{name}: {what}").into());
        }
        if self.precision != PrecisionChoice::Exact && tally.narrowed() == 0 {
            log::warn!("{name}: it has no frame of f32 boxes, so that nothing was sent otherwise");
        }
        let shown = self.shown(&tally);
        if self.json { print_json(&shown) } else { print_text(&shown.text) }?;
        match tally.differing() {
            0 => Ok(()),
            differing => Err(format!("{differing} of {} answers differ", tally.requests()).into()),
        }
    }

    fn check(&self, common: &CommonOptions) -> Result {
        let named = [self.engine, self.compare].into_iter().flatten();
        let has_gpu = |engine| matches!(engine, EngineChoice::Only(name) if name.is_gpu());
        let what = if self.in_process && named.into_iter().any(has_gpu) {
            "--in-process has the engines of cores: name one of those, or leave it out"
        } else if self.in_process && common.named_instance().is_some() {
            "--in-process asks no daemon: leave --instance out"
        } else {
            return Ok(());
        };
        Err(WrongUsage(what.to_owned()).into())
    }

    /// What the other answers are, that the first ones are compared with.
    fn compared(&self) -> Option<String> {
        let exact = (self.precision != PrecisionChoice::Exact).then(|| "as recorded".to_owned());
        self.compare.map(|engine| engine.to_string()).or(exact)
    }

    fn shown(&self, tally: &Tally) -> Shown {
        let fields = json!({
            "machine": Machine::this(),
            "requests": tally.requests(),
            "differing": tally.differing(),
            "uncompared": tally.uncompared(),
            "skipped": tally.skipped(),
            "narrowed": tally.narrowed(),
            "extra_pairs": tally.extra_pairs(),
            "cut_sessions": tally.cut_sessions,
            "ends_early": tally.ends_early,
            "differences": tally.described,
            "rows": tally.rows().map(fields_of).collect::<Vec<_>>(),
        });
        Shown { fields, text: self.text(tally) }
    }

    // Writing to a string cannot fail.
    fn text(&self, tally: &Tally) -> String {
        let (requests, differing) = (tally.requests(), tally.differing());
        let mut text = format!("{requests} requests, {differing} answers differ");
        if tally.uncompared() > 0 {
            let _ = write!(text, ", {} were not recorded", tally.uncompared());
        }
        if tally.skipped() > 0 {
            let _ = write!(text, ", {} of shared scenes were left out", tally.skipped());
        }
        if tally.narrowed() > 0 {
            let (narrowed, extra) = (tally.narrowed(), tally.extra_pairs());
            let _ =
                write!(text, "\n{narrowed} frames sent as {}: {extra} pairs more", self.precision);
        }
        let mut heads = vec!["recorded".to_owned(), "now".into(), "round trip".into()];
        if let Some(compared) = self.compared() {
            heads.extend([compared, "round trip".into()]);
        }
        let _ = write!(text, "\n\n{:<9}{:>9}", "µs", "");
        for head in &heads {
            let _ = write!(text, "{head:>20}");
        }
        let _ = write!(text, "\n{:<9}{:>9}", "", "requests");
        for _ in &heads {
            let _ = write!(text, "{:>10}{:>10}", "p50", "p99");
        }
        for row in tally.rows() {
            let _ = write!(text, "\n{:<9}{:>9}", row.kind.plural(), row.requests);
            let played = row.played.iter().flat_map(|times| [&times.daemon, &times.round_trip]);
            for recorder in std::iter::once(&row.recorded).chain(played) {
                let _ = write!(text, "{}", columns(recorder));
            }
        }
        for difference in &tally.described {
            let _ = write!(text, "\n{difference}");
        }
        text
    }
}

fn fields_of(row: &Row) -> Value {
    let Row { kind, requests, differing, uncompared, skipped, narrowed, extra_pairs, .. } = row;
    let (recorded, played) = (&row.recorded, &row.played);
    let times = |times: &Latencies| {
        json!({
            "daemon_ns": times.daemon.percentiles(),
            "round_trip_ns": times.round_trip.percentiles(),
        })
    };
    json!({
        "kind": kind,
        "requests": requests,
        "differing": differing,
        "uncompared": uncompared,
        "skipped": skipped,
        "narrowed": narrowed,
        "extra_pairs": extra_pairs,
        "recorded_ns": recorded.percentiles(),
        "now": played.first().map(times),
        "compared": played.get(1).map(times),
    })
}

fn columns(recorder: &Recorder) -> String {
    let Percentiles { p50, p99, .. } = recorder.percentiles();
    [p50, p99].map(|ns| format!("{:>10.1}", ns as f64 / 1e3)).concat()
}

fn open(path: &Path) -> Result<Recording<Box<dyn Read>>> {
    let from: Box<dyn Read> = if is_stdout(path) {
        Box::new(std::io::stdin().lock())
    } else {
        let file = File::open(path).map_err(FileError::of(path, Access::Read))?;
        Box::new(BufReader::new(file))
    };
    let named = |error: ReadError| format!("{}: {error}", path.display());
    Ok(Recording::open(from).map_err(named)?)
}
