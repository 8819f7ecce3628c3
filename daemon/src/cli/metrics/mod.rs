//! Metrics of instances as text: `OpenMetrics` 1.0, or the older text of Prometheus that `node_exporter` reads from files.
//!
//! All are of counters and status files that daemons write anyway: none is asked.

mod file;

use std::fmt::{self, Display, Write};

use pairmask_transport::{ClientCounts, CounterSample, RuntimeDir, StatusFile};
use pairmask_wire::{InstanceName, SkipTotals};

pub use self::file::MetricsFile;

/// What the text is for.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Format {
    OpenMetrics,
    /// It knows no units, and names a counter with its suffix.
    Prometheus,
}

/// What is known of an instance.
#[derive(Debug)]
pub struct Scrape {
    instance: String,
    is_alive: bool,
    status: Option<StatusFile>,
    sample: Option<CounterSample>,
}

impl Scrape {
    pub const fn is_alive(&self) -> bool {
        self.is_alive
    }

    pub fn of(dir: &RuntimeDir, name: &InstanceName) -> Self {
        // What cannot be read is not there.
        Self {
            instance: name.to_string(),
            is_alive: dir.is_served(name),
            status: dir.read_status(name).ok().flatten(),
            sample: dir.read_counters(name).ok().flatten(),
        }
    }

    const fn known(&self) -> Known {
        Known {
            is_alive: self.is_alive,
            has_status: self.status.is_some(),
            has_counters: self.sample.is_some(),
        }
    }
}

/// Which metrics a scrape has. A worker lives for a moment before it has counters, and a file that was written then
/// would be without them until the next is due: where metrics have come or gone it is written at the next look.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
struct Known {
    is_alive: bool,
    has_status: bool,
    has_counters: bool,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Kind {
    Gauge,
    Counter,
}

#[derive(Clone, Copy, Debug)]
enum Value {
    Number(u64),
    Seconds(u64),
}

impl Display for Value {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Number(n) => write!(f, "{n}"),
            Self::Seconds(ns) => write!(f, "{}.{:09}", ns / 1_000_000_000, ns % 1_000_000_000),
        }
    }
}

/// A further label, and the value with it.
type Labelled = (&'static str, &'static str, Value);

/// One metric of instances or of clients.
struct Metric<T> {
    /// Without the suffix of a counter. A unit is its last word.
    name: &'static str,
    kind: Kind,
    unit: &'static str,
    help: &'static str,
    values: fn(&T) -> Vec<Labelled>,
}

/// A metric without a further label; none where it is not known.
fn one(value: Option<Value>) -> Vec<Labelled> {
    value.map(|value| ("", "", value)).into_iter().collect()
}

macro_rules! of_status {
    ($($field:ident).+) => {
        |scrape| one(scrape.status.as_ref().map(|status| Value::Number(status.$($field).+.into())))
    };
}

macro_rules! of_totals {
    ($value:ident, $field:ident) => {
        |scrape| one(scrape.sample.as_ref().map(|sample| Value::$value(sample.totals.$field)))
    };
}

macro_rules! of_client {
    ($value:ident, $field:ident) => {
        |client| one(Some(Value::$value(client.$field)))
    };
}

const fn gauge<T>(
    name: &'static str,
    unit: &'static str,
    help: &'static str,
    values: fn(&T) -> Vec<Labelled>,
) -> Metric<T> {
    Metric { name, kind: Kind::Gauge, unit, help, values }
}

const fn counter<T>(
    name: &'static str,
    unit: &'static str,
    help: &'static str,
    values: fn(&T) -> Vec<Labelled>,
) -> Metric<T> {
    Metric { name, kind: Kind::Counter, unit, help, values }
}

/// Of each instance.
const METRICS: [Metric<Scrape>; 24] = [
    gauge("pairmask_up", "", "Whether the worker lives.", |scrape| {
        one(Some(Value::Number(scrape.is_alive.into())))
    }),
    gauge(
        "pairmask_uptime_seconds",
        "seconds",
        "Time since the worker began.",
        of_totals!(Seconds, uptime_ns),
    ),
    gauge("pairmask_clients", "", "Connected clients.", of_status!(body.client_count)),
    counter(
        "pairmask_frames",
        "",
        "Frames, edits, queries and casts that were answered.",
        of_totals!(Number, frames),
    ),
    counter("pairmask_boxes", "", "Boxes of these.", of_totals!(Number, boxes)),
    counter("pairmask_spheres", "", "Spheres of these.", of_totals!(Number, spheres)),
    counter("pairmask_pairs", "", "Pairs and hits in answers.", of_totals!(Number, pairs)),
    counter(
        "pairmask_errors",
        "",
        "Requests that were answered with an error.",
        of_totals!(Number, errors),
    ),
    counter(
        "pairmask_repeated_frames",
        "",
        "Frames equal to their session's last one.",
        of_status!(skips.repeats),
    ),
    counter("pairmask_skipped_pairs", "", "Pairs that were never compared, by reason.", skipped),
    counter("pairmask_received_bytes", "bytes", "Requests.", of_totals!(Number, received_bytes)),
    counter("pairmask_sent_bytes", "bytes", "Answers.", of_totals!(Number, sent_bytes)),
    counter(
        "pairmask_cpu_seconds",
        "seconds",
        "CPU time of the worker.",
        of_totals!(Seconds, cpu_ns),
    ),
    counter(
        "pairmask_gpu_seconds",
        "seconds",
        "Time that GPUs took for requests.",
        of_totals!(Seconds, gpu_ns),
    ),
    gauge("pairmask_gpus", "", "GPUs that serve.", of_status!(gpus.open)),
    gauge("pairmask_gpus_opening", "", "GPUs that are being opened.", of_status!(gpus.opening)),
    gauge(
        "pairmask_waiting_requests",
        "",
        "Requests that wait for their turn.",
        of_totals!(Number, waiting),
    ),
    gauge(
        "pairmask_serving_requests",
        "",
        "Requests that are being served.",
        of_totals!(Number, serving),
    ),
    gauge(
        "pairmask_memory_bytes",
        "bytes",
        "Memory that worker and clients take.",
        of_totals!(Number, memory_bytes),
    ),
    gauge(
        "pairmask_memory_limit_bytes",
        "bytes",
        "The most that they may take.",
        of_totals!(Number, memory_limit_bytes),
    ),
    gauge("pairmask_scenes", "", "Persistent scenes.", of_status!(body.scenes)),
    counter(
        "pairmask_audited_frames",
        "",
        "Answers that were checked again.",
        of_status!(body.audit.frames),
    ),
    counter(
        "pairmask_audit_missed_pairs",
        "",
        "Pairs that were missing in them.",
        of_status!(body.audit.missed),
    ),
    counter(
        "pairmask_audit_extra_pairs",
        "",
        "Pairs that were too many in them.",
        of_status!(body.audit.extra),
    ),
];

fn skipped(scrape: &Scrape) -> Vec<Labelled> {
    let Some(StatusFile { skips, .. }) = scrape.status else { return Vec::new() };
    let SkipTotals { static_pairs, unmoved_pairs, empty_pairs, cell_pairs, axis_pairs, .. } = skips;
    let why = [
        ("static", static_pairs),
        ("unmoved", unmoved_pairs),
        ("empty", empty_pairs),
        ("cell", cell_pairs),
        ("axis", axis_pairs),
    ];
    why.map(|(why, pairs)| ("why", why, Value::Number(pairs))).to_vec()
}

/// Of each client that is connected.
const CLIENT_METRICS: [Metric<ClientCounts>; 12] = [
    counter(
        "pairmask_client_frames",
        "",
        "Frames, edits, queries and casts of a client that were answered.",
        of_client!(Number, frames),
    ),
    counter("pairmask_client_edits", "", "Edits among these.", of_client!(Number, edits)),
    counter("pairmask_client_boxes", "", "Boxes and spheres of these.", of_client!(Number, boxes)),
    counter(
        "pairmask_client_pairs",
        "",
        "Pairs and hits in answers to a client.",
        of_client!(Number, pairs),
    ),
    counter(
        "pairmask_client_errors",
        "",
        "Requests of a client that were answered with an error.",
        of_client!(Number, errors),
    ),
    counter(
        "pairmask_client_stage_seconds",
        "seconds",
        "Time of a client's requests by stage.",
        stages,
    ),
    counter(
        "pairmask_client_cpu_seconds",
        "seconds",
        "Time of the threads that served a client, or of a GPU.",
        of_client!(Seconds, used_ns),
    ),
    counter(
        "pairmask_client_received_bytes",
        "bytes",
        "Requests of a client.",
        of_client!(Number, received_bytes),
    ),
    counter(
        "pairmask_client_sent_bytes",
        "bytes",
        "Answers to a client.",
        of_client!(Number, sent_bytes),
    ),
    gauge(
        "pairmask_client_memory_bytes",
        "bytes",
        "Memory that a client takes.",
        of_client!(Number, memory_bytes),
    ),
    gauge(
        "pairmask_client_last_boxes",
        "",
        "Boxes of a client's last frame, or in the scene that it edited last.",
        of_client!(Number, last_boxes),
    ),
    gauge("pairmask_client_last_pairs", "", "Pairs of the same.", of_client!(Number, last_pairs)),
];

fn stages(client: &ClientCounts) -> Vec<Labelled> {
    let stages = [
        ("wait", client.wait_ns),
        ("ingest", client.ingest_ns),
        ("plan", client.plan_ns),
        ("execute", client.execute_ns),
        ("publish", client.publish_ns),
    ];
    stages.map(|(stage, ns)| ("stage", stage, Value::Seconds(ns))).to_vec()
}

/// The metrics of instances.
pub fn text(scrapes: &[Scrape], format: Format) -> String {
    let mut text = String::new();
    for metric in &METRICS {
        let samples = scrapes.iter().flat_map(|scrape| {
            let labels = format!("instance=\"{}\"", escaped(&scrape.instance));
            samples_of(&labels, (metric.values)(scrape))
        });
        write_family(&mut text, metric, &samples.collect::<Vec<_>>(), format);
    }
    let clients = || {
        scrapes.iter().flat_map(|scrape| {
            let clients = scrape.sample.iter().flat_map(|sample| &sample.clients);
            clients.map(move |client| (&scrape.instance, client))
        })
    };
    for metric in &CLIENT_METRICS {
        let samples = clients().flat_map(|(instance, client)| {
            let labels = format!(
                "instance=\"{}\",session=\"{}\",process=\"{}\",name=\"{}\"",
                escaped(instance),
                client.session,
                client.process,
                escaped(&client.process_name())
            );
            samples_of(&labels, (metric.values)(client))
        });
        write_family(&mut text, metric, &samples.collect::<Vec<_>>(), format);
    }
    if format == Format::OpenMetrics {
        text.push_str("# EOF\n");
    }
    text
}

/// Labels and value of each sample.
fn samples_of(labels: &str, values: Vec<Labelled>) -> Vec<(String, Value)> {
    let labelled = |(name, of, value): Labelled| match name {
        "" => (labels.to_owned(), value),
        name => (format!("{labels},{name}=\"{of}\""), value),
    };
    values.into_iter().map(labelled).collect()
}

fn write_family<T>(
    text: &mut String,
    metric: &Metric<T>,
    samples: &[(String, Value)],
    format: Format,
) {
    if samples.is_empty() {
        return;
    }
    let Metric { name, kind, unit, help, .. } = metric;
    let (kind, suffix) = match kind {
        Kind::Gauge => ("gauge", ""),
        Kind::Counter => ("counter", "_total"),
    };
    let family = match format {
        Format::OpenMetrics => (*name).to_owned(),
        Format::Prometheus => format!("{name}{suffix}"),
    };
    // Writing to a string cannot fail.
    let _ = writeln!(text, "# TYPE {family} {kind}");
    if format == Format::OpenMetrics && !unit.is_empty() {
        let _ = writeln!(text, "# UNIT {family} {unit}");
    }
    let _ = writeln!(text, "# HELP {family} {help}");
    for (labels, value) in samples {
        let _ = writeln!(text, "{name}{suffix}{{{labels}}} {value}");
    }
}

/// A label's value: a process chooses its name freely.
fn escaped(text: &str) -> String {
    text.replace('\\', "\\\\").replace('"', "\\\"").replace('\n', "\\n")
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn names_end_in_their_unit_and_are_there_once() {
        let of = |name: &'static str, unit: &'static str| {
            assert!(unit.is_empty() || name.ends_with(&format!("_{unit}")), "{name}");
            assert!(name.starts_with("pairmask_") && !name.ends_with("_total"), "{name}");
            name
        };
        let mut names: Vec<_> = METRICS.iter().map(|m| of(m.name, m.unit)).collect();
        names.extend(CLIENT_METRICS.iter().map(|m| of(m.name, m.unit)));
        let count = names.len();
        names.sort_unstable();
        names.dedup();
        assert_eq!(names.len(), count);
    }

    #[test]
    fn a_name_may_hold_anything() {
        let name: [u64; 2] = [u64::from_le_bytes(*b"a\"b\\c\n{}"), u64::from_le_bytes([0xff; 8])];
        let client =
            ClientCounts { session: 1, name, wait_ns: 1_500_000_000, ..Default::default() };
        let sample = CounterSample { clients: vec![client], ..CounterSample::default() };
        let scrape = Scrape {
            instance: "world".to_owned(),
            is_alive: true,
            status: None,
            sample: Some(sample),
        };
        let text = text(&[scrape], Format::Prometheus);
        assert!(text.contains(r#"name="a\"b\\c{}"#), "{text}");
        assert!(text.contains("stage=\"wait\"} 1.500000000\n"), "{text}");
        assert!(text.contains("# TYPE pairmask_client_edits_total counter\n"), "{text}");
        assert!(text.contains("pairmask_up{instance=\"world\"} 1\n"), "{text}");
        assert!(!text.contains("UNIT") && !text.contains("EOF"));
    }
}
