//! `top`: clients and scenes of a daemon as they are served, by its counters. The daemon is not asked, so that one that
//! hangs or was killed is seen too.
//!
//! ```text
//! view    what the user has chosen, and keys      (pure)
//! table   rows, their order, columns              (pure)
//! draw    the screen, from two looks and the view (pure)
//! ```

mod draw;
mod table;
mod view;

use std::fmt::Write;
use std::num::NonZeroU32;
use std::time::{Duration, Instant};

use clap::Args;
use pairmask_transport::{DaemonRecord, RuntimeDir};
use pairmask_wire::InstanceName;
use serde_json::json;

use self::draw::{Source, Styles, draw};
use self::table::{LEAST_WIDTH, Selection, head, line, long_time};
use self::view::{Then, View};
use super::options::CommonOptions;
use super::output::{OutputError, print_json, print_text, size_text};
use super::program::Result;
use super::rates::{Look, Rates};
use super::status::{none_answers, records};
use super::terminal::{Screen, Waited, can_draw, has_colours};
use super::whole_number::whole_number;

/// The second look comes after this time at the latest.
const FIRST_INTERVAL: Duration = Duration::from_millis(300);

/// Width of the plain table: that of the widest columns.
const PLAIN_WIDTH: usize = 132;

const _: () = assert!(PLAIN_WIDTH >= LEAST_WIDTH);

/// Watch clients and scenes as they are served
#[derive(Debug, Args)]
#[command(after_help = "\
Examples:
  pairmaskd top                        until q; ? lists keys and columns
  pairmaskd top --instance world --interval 200
  pairmaskd top --once                 one plain table, for scripts and logs
  pairmaskd top --json | jq '.clients[].frames_per_second'

It reads counters that the daemon keeps in a file, and asks it nothing. Where stdout is no terminal it
prints one table. NO_COLOR is honoured.")]
pub struct Top {
    /// Time between two looks, ms
    #[arg(long, value_parser = whole_number::<NonZeroU32>, value_name = "MS", default_value = "1000")]
    interval: NonZeroU32,
    /// Print one plain table of an interval
    #[arg(long)]
    once: bool,
    /// Print one JSON object of an interval
    #[arg(long)]
    json: bool,
}

impl Top {
    pub fn run(&self, common: &CommonOptions) -> Result {
        let dir = common.runtime_dir();
        let watched = Watched::find(&dir, common.named_instance().as_ref())?;
        let interval = Duration::from_millis(self.interval.get().into());
        let look = || watched.look(interval);
        if self.json || self.once || !can_draw() {
            let before = look()?.1.unwrap_or_default();
            std::thread::sleep(interval);
            let (source, now) = look()?;
            let now = now.unwrap_or_default();
            let rates = Rates::between(&before, &now);
            if self.json {
                let mut report = json!({
                    "instance": source.instance,
                    "state": if source.is_alive { "alive" } else { "dead" },
                    "pid": watched.record().map(|record| record.worker_pid),
                    "interval_ns": now.at.saturating_sub(before.at).as_nanos() as u64,
                });
                let rates = serde_json::to_value(&rates).map_err(OutputError::from)?;
                if let (Some(report), serde_json::Value::Object(rates)) =
                    (report.as_object_mut(), rates)
                {
                    report.extend(rates);
                }
                return Ok(print_json(&report)?);
            }
            return Ok(print_text(plain(&source, &rates).trim_end())?);
        }
        show(&mut Screen::open()?, interval, Styles::new(has_colours()), look)
    }
}

/// Shows looks, one each interval, until the user quits or a signal comes.
fn show(
    screen: &mut Screen,
    interval: Duration,
    styles: Styles,
    mut look: impl FnMut() -> Result<(Source, Option<Look>)>,
) -> Result {
    let mut view = View::default();
    let (mut source, first) = look()?;
    let (mut now, mut before) = (first.unwrap_or_default(), None);
    // There are no rates before the second look.
    let mut due = Instant::now() + interval.min(FIRST_INTERVAL);
    loop {
        let mut most_scroll = 0;
        let looks = (&now, before.as_ref());
        screen.draw(|frame| most_scroll = draw(frame, looks, &source, &view, styles))?;
        view.scroll = view.scroll.min(most_scroll);
        match screen.wait(due)? {
            Waited::Stop => return Ok(()),
            Waited::Key(key) if view.press(key) == Then::Quit => return Ok(()),
            Waited::Key(_) | Waited::Other | Waited::Due => {}
        }
        if Instant::now() >= due {
            due = Instant::now() + interval;
            let (next_source, next) = look()?;
            if !view.is_paused {
                source = next_source;
                if let Some(next) = next {
                    before = Some(std::mem::replace(&mut now, next));
                }
            }
        }
    }
}

/// The instance that is watched.
struct Watched {
    dir: RuntimeDir,
    name: InstanceName,
}

impl Watched {
    /// The instance of this name; where none is named the default one, or any other.
    fn find(dir: &RuntimeDir, named: Option<&InstanceName>) -> Result<Self> {
        let mut all = records(dir, named);
        let default = InstanceName::default();
        let at = all.iter().position(|(_, name, _)| *name == default).unwrap_or(0);
        if at < all.len() {
            let (dir, name, _) = all.swap_remove(at);
            return Ok(Self { dir, name });
        }
        Err(none_answers(dir, named))
    }

    fn record(&self) -> Option<DaemonRecord> {
        self.dir.read_record(&self.name)
    }

    fn look(&self, interval: Duration) -> Result<(Source, Option<Look>)> {
        let look = Look::read(&self.dir, &self.name)?;
        let record = self.record();
        let is_alive = matches!(self.dir.watch(&self.name, record.as_ref()), Ok(Some(_)));
        let state = match (&record, &look) {
            (Some(record), Some(_)) if is_alive => format!("alive, process {}", record.worker_pid),
            (Some(record), Some(_)) => {
                format!("process {} has exited: its last counts", record.worker_pid)
            }
            (Some(_), None) => "it has no counters: is it of an earlier version?".to_owned(),
            (None, _) => "it has stopped".to_owned(),
        };
        let source = Source {
            instance: self.name.to_string(),
            state,
            is_alive,
            interval_ms: interval.as_millis() as u64,
            cores: std::thread::available_parallelism().map_or(1, usize::from),
        };
        Ok((source, look))
    }
}

/// The plain table.
fn plain(source: &Source, rates: &Rates) -> String {
    let (totals, selection) = (&rates.totals, Selection::default());
    let mut text = String::new();
    // Writing to a string cannot fail.
    let _ = writeln!(
        text,
        "{}: {}, serving for {}; {:.0} frames/s, {} errors, CPU {:.0} %, memory {} of {}; {} waiting, {} served",
        source.instance,
        source.state,
        long_time(totals.uptime_ns),
        totals.frames_per_second,
        totals.errors,
        totals.cpu_share * 100.0,
        size_text(totals.memory_bytes),
        size_text(totals.memory_limit_bytes),
        totals.waiting,
        totals.serving,
    );
    if !totals.gpus.is_empty() {
        let _ = writeln!(
            text,
            "GPU: {}, {:.0} % busy",
            totals.gpus.join(", "),
            totals.gpu_share * 100.0
        );
    }
    let rows = selection.rows(rates);
    if rows.is_empty() {
        text.push_str("no client is connected\n");
        return text;
    }
    let _ = writeln!(text, "times are means of a frame in µs\n{}", head(PLAIN_WIDTH, &selection));
    for row in &rows {
        let _ = writeln!(text, "{}", line(row, PLAIN_WIDTH).trim_end());
    }
    text
}
