//! What clients and scenes of an instance did between two looks at its counters.

use std::sync::LazyLock;
use std::time::{Duration, Instant};

use pairmask_core::EngineName;
use pairmask_transport::{ClientCounts, CounterSample, RuntimeDir, SceneCounts, TotalCounts};
use pairmask_wire::{InstanceError, InstanceName};
use serde::{Serialize, Serializer};

use crate::daemon_cpu::cpu_of;

/// The counters of an instance, and when they were read.
#[derive(Clone, Debug, Default)]
pub struct Look {
    /// Since any moment, the same for all looks that are compared.
    pub at: Duration,
    pub sample: CounterSample,
    /// CPU time of the worker, where it lives and /proc shows it: the counters have it to the half second.
    pub cpu: Option<Duration>,
}

impl Look {
    /// Reads the counters of an instance; `None` where it has none.
    pub fn read(dir: &RuntimeDir, name: &InstanceName) -> Result<Option<Self>, InstanceError> {
        static BEGUN: LazyLock<Instant> = LazyLock::new(Instant::now);
        let begun = *BEGUN;
        let Some(sample) = dir.read_counters(name)? else { return Ok(None) };
        let (at, cpu) = (begun.elapsed(), cpu_of(sample.worker));
        Ok(Some(Self { at, sample, cpu }))
    }
}

/// All clients together.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct TotalRates {
    pub uptime_ns: u64,
    pub frames: u64,
    pub boxes: u64,
    pub spheres: u64,
    pub pairs: u64,
    pub errors: u64,
    pub received_bytes: u64,
    pub sent_bytes: u64,
    pub frames_per_second: f64,
    pub boxes_per_second: f64,
    pub pairs_per_second: f64,
    pub received_bytes_per_second: f64,
    pub sent_bytes_per_second: f64,
    pub waiting: u64,
    pub serving: u64,
    pub memory_bytes: u64,
    pub memory_limit_bytes: u64,
    /// 1 is a core all the time.
    pub cpu_share: f64,
    /// 1 is a GPU all the time.
    pub gpu_share: f64,
    pub gpus: Vec<String>,
}

/// Mean times of a request, ns; `None` where there was none.
#[allow(clippy::struct_field_names)] // Those of the JSON.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize)]
pub struct StageMeans {
    pub wait_ns: Option<u64>,
    pub ingest_ns: Option<u64>,
    pub plan_ns: Option<u64>,
    pub execute_ns: Option<u64>,
    pub publish_ns: Option<u64>,
    pub total_ns: Option<u64>,
}

/// One session.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct ClientRates {
    pub session: u64,
    pub process: u64,
    pub user: u64,
    pub name: String,
    /// As `last_errors` of `status` name it.
    #[serde(serialize_with = "as_hex")]
    pub client: u64,
    pub connected_ns: u64,
    pub boxes: u64,
    pub moved_share: Option<f64>,
    pub pairs: u64,
    pub engine: Option<&'static str>,
    pub threads: u64,
    pub frames: u64,
    pub edits: u64,
    pub queries: u64,
    pub errors: u64,
    pub frames_per_second: f64,
    pub stages: StageMeans,
    /// 1 is a core all the time.
    pub cpu_share: f64,
    pub received_bytes_per_second: f64,
    pub sent_bytes_per_second: f64,
    pub memory_bytes: u64,
    pub scenes: Vec<SceneRates>,
}

/// One scene.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct SceneRates {
    /// The client's number of it, or the worker's of one that several clients share.
    pub scene: u64,
    pub boxes: u64,
    pub moved_share: Option<f64>,
    pub pairs: u64,
    pub engine: Option<&'static str>,
    pub edits: u64,
    pub edits_per_second: f64,
    pub ingest_ns: Option<u64>,
    pub execute_ns: Option<u64>,
    pub memory_bytes: u64,
}

/// What an instance did between two looks.
#[derive(Clone, Debug, Default, PartialEq, Serialize)]
pub struct Rates {
    pub totals: TotalRates,
    pub clients: Vec<ClientRates>,
    pub shared_scenes: Vec<SceneRates>,
}

// By reference, as serde has it.
#[allow(clippy::trivially_copy_pass_by_ref)]
fn as_hex<S: Serializer>(token: &u64, serializer: S) -> Result<S::Ok, S::Error> {
    serializer.collect_str(&format_args!("{token:016x}"))
}

fn engine_name(wire_number: u64) -> Option<&'static str> {
    EngineName::from_wire(u32::try_from(wire_number).ok()?).map(EngineName::as_str)
}

/// Differences of sums. What a file says may be anything: a sum that has shrunk did not change.
struct Since {
    seconds: f64,
}

impl Since {
    fn a_second(&self, now: u64, before: u64) -> f64 {
        now.saturating_sub(before) as f64 / self.seconds
    }

    fn share(&self, now_ns: u64, before_ns: u64) -> f64 {
        self.a_second(now_ns, before_ns) / 1e9
    }
}

fn mean(now: u64, before: u64, count: u64) -> Option<u64> {
    now.saturating_sub(before).checked_div(count)
}

fn moved_share([moved, moved_before]: [u64; 2], [kept, kept_before]: [u64; 2]) -> Option<f64> {
    let (moved, kept) = (moved.saturating_sub(moved_before), kept.saturating_sub(kept_before));
    // Boxes that an edit removes again, or sets twice, are no more than all.
    (kept > 0).then(|| (moved as f64 / kept as f64).min(1.0))
}

impl Rates {
    /// Of looks at one instance. Where another worker counts since, or where there was none before, all that it counted
    /// counts as if it were of the time between.
    pub fn between(before: &Look, now: &Look) -> Self {
        let seconds = now.at.saturating_sub(before.at).as_secs_f64().max(1e-6);
        let since = Since { seconds };
        let nothing = CounterSample::default();
        let same = before.sample.worker == now.sample.worker;
        let before_sample = if same { &before.sample } else { &nothing };
        let scene = |scene: &SceneCounts| {
            let known = before_sample.scenes.iter().find(|known| known.number == scene.number);
            scene_rates(scene, &known.copied().unwrap_or_default(), &since)
        };
        let client = |client: &ClientCounts| {
            let known = before_sample.clients.iter().find(|known| known.session == client.session);
            let known = known.copied().unwrap_or_default();
            let its = now.sample.scenes.iter().filter(|scene| scene.session == client.session);
            ClientRates {
                connected_ns: now.sample.totals.uptime_ns.saturating_sub(client.connected_at_ns),
                scenes: its.map(scene).collect(),
                ..client_rates(client, &known, &since)
            }
        };
        let shared = now.sample.scenes.iter().filter(|scene| scene.session == 0);
        let shared = shared.map(|counts| SceneRates { scene: counts.number, ..scene(counts) });
        let mut totals = total_rates(&now.sample, &before_sample.totals, &since);
        if let (Some(now), Some(before), true) = (now.cpu, before.cpu, same) {
            totals.cpu_share = now.saturating_sub(before).as_secs_f64() / seconds;
        }
        Self {
            totals,
            clients: now.sample.clients.iter().map(client).collect(),
            shared_scenes: shared.collect(),
        }
    }
}

fn total_rates(now: &CounterSample, before: &TotalCounts, since: &Since) -> TotalRates {
    let totals = &now.totals;
    TotalRates {
        uptime_ns: totals.uptime_ns,
        frames: totals.frames,
        boxes: totals.boxes,
        spheres: totals.spheres,
        pairs: totals.pairs,
        errors: totals.errors,
        received_bytes: totals.received_bytes,
        sent_bytes: totals.sent_bytes,
        frames_per_second: since.a_second(totals.frames, before.frames),
        boxes_per_second: since.a_second(totals.boxes, before.boxes),
        pairs_per_second: since.a_second(totals.pairs, before.pairs),
        received_bytes_per_second: since.a_second(totals.received_bytes, before.received_bytes),
        sent_bytes_per_second: since.a_second(totals.sent_bytes, before.sent_bytes),
        waiting: totals.waiting,
        serving: totals.serving,
        memory_bytes: totals.memory_bytes,
        memory_limit_bytes: totals.memory_limit_bytes,
        cpu_share: since.share(totals.cpu_ns, before.cpu_ns),
        gpu_share: since.share(totals.gpu_ns, before.gpu_ns),
        gpus: now.gpus.clone(),
    }
}

fn client_rates(now: &ClientCounts, before: &ClientCounts, since: &Since) -> ClientRates {
    let count = now.frames.saturating_sub(before.frames);
    ClientRates {
        session: now.session,
        process: now.process,
        user: now.user,
        name: now.process_name(),
        client: now.token,
        connected_ns: 0,
        boxes: now.last_boxes,
        moved_share: moved_share([now.moved, before.moved], [now.kept, before.kept]),
        pairs: now.last_pairs,
        engine: engine_name(now.engine),
        threads: now.threads,
        frames: now.frames,
        edits: now.edits,
        queries: now.queries,
        errors: now.errors,
        frames_per_second: since.a_second(now.frames, before.frames),
        stages: StageMeans {
            wait_ns: mean(now.wait_ns, before.wait_ns, count),
            ingest_ns: mean(now.ingest_ns, before.ingest_ns, count),
            plan_ns: mean(now.plan_ns, before.plan_ns, count),
            execute_ns: mean(now.execute_ns, before.execute_ns, count),
            publish_ns: mean(now.publish_ns, before.publish_ns, count),
            total_ns: mean(now.total_ns, before.total_ns, count),
        },
        cpu_share: since.share(now.used_ns, before.used_ns),
        received_bytes_per_second: since.a_second(now.received_bytes, before.received_bytes),
        sent_bytes_per_second: since.a_second(now.sent_bytes, before.sent_bytes),
        memory_bytes: now.memory_bytes,
        scenes: Vec::new(),
    }
}

fn scene_rates(now: &SceneCounts, before: &SceneCounts, since: &Since) -> SceneRates {
    let count = now.edits.saturating_sub(before.edits);
    SceneRates {
        scene: now.scene,
        boxes: now.boxes,
        moved_share: moved_share([now.moved, before.moved], [now.kept, before.kept]),
        pairs: now.pairs,
        engine: engine_name(now.engine),
        edits: now.edits,
        edits_per_second: since.a_second(now.edits, before.edits),
        ingest_ns: mean(now.ingest_ns, before.ingest_ns, count),
        execute_ns: mean(now.execute_ns, before.execute_ns, count),
        memory_bytes: now.memory_bytes,
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn look(seconds: u64, worker: u32, clients: Vec<ClientCounts>) -> Look {
        let frames = clients.iter().map(|client| client.frames).sum();
        let totals =
            TotalCounts { frames, uptime_ns: seconds * 1_000_000_000, ..Default::default() };
        let sample = CounterSample { worker, totals, clients, ..CounterSample::default() };
        Look { at: Duration::from_secs(seconds), sample, cpu: None }
    }

    fn client(session: u64, frames: u64) -> ClientCounts {
        ClientCounts {
            session,
            frames,
            execute_ns: 500 * frames,
            moved: 10 * frames,
            kept: 40 * frames,
            used_ns: 1_000_000 * frames,
            engine: EngineName::CpuGrid as u64,
            ..ClientCounts::default()
        }
    }

    #[test]
    fn rates_are_of_the_time_between_two_looks() {
        let before = look(10, 1, vec![client(1, 100), client(2, 7)]);
        let now = look(12, 1, vec![client(1, 300), client(2, 7), client(3, 20)]);
        let rates = Rates::between(&before, &now);
        let per_second: Vec<_> = rates.clients.iter().map(|c| c.frames_per_second).collect();
        assert_eq!(per_second, [100.0, 0.0, 10.0], "one that has just come began at nothing");
        let [busy, idle, _] = &rates.clients[..] else { panic!("{rates:?}") };
        assert_eq!((busy.moved_share, busy.stages.execute_ns), (Some(0.25), Some(500)));
        assert_eq!((idle.moved_share, idle.stages.execute_ns), (None, None));
        assert_eq!((busy.cpu_share, busy.engine), (0.1, Some("cpu-grid")));
        assert_eq!(rates.totals.frames_per_second, 110.0);
    }

    #[test]
    fn another_worker_counts_from_nothing() {
        let rates =
            Rates::between(&look(10, 1, vec![client(1, 100)]), &look(11, 2, vec![client(1, 4)]));
        assert_eq!(rates.clients[0].frames_per_second, 4.0);
    }

    #[test]
    fn what_makes_no_sense_is_no_rate_and_no_panic() {
        let wild =
            ClientCounts { frames: u64::MAX, wait_ns: u64::MAX, engine: u64::MAX, ..client(1, 9) };
        for (before, now) in [(client(1, 100), wild), (wild, client(1, 5))] {
            let rates = Rates::between(&look(2, 1, vec![before]), &look(1, 1, vec![now]));
            assert!(rates.clients[0].frames_per_second.is_finite());
        }
        let shrunk =
            Rates::between(&look(1, 1, vec![client(1, 9)]), &look(2, 1, vec![client(1, 5)]));
        assert_eq!(shrunk.clients[0].frames_per_second, 0.0);
    }

    #[test]
    fn scenes_stand_with_their_clients_and_shared_ones_alone() {
        let scene = |number, session, scene| SceneCounts {
            number,
            session,
            scene,
            edits: 10,
            ..SceneCounts::default()
        };
        let mut now = look(2, 1, vec![client(1, 5), client(2, 5)]);
        now.sample.scenes = vec![scene(7, 2, 30), scene(8, 0, 0), scene(9, 4, 1)];
        let rates = Rates::between(&look(1, 1, vec![]), &now);
        assert_eq!(rates.clients[0].scenes, []);
        let [its] = &rates.clients[1].scenes[..] else { panic!("{rates:?}") };
        assert_eq!((its.scene, its.edits_per_second), (30, 10.0));
        assert_eq!(rates.shared_scenes.iter().map(|s| s.scene).collect::<Vec<_>>(), [8]);
    }
}
