//! The contenders of a scene.

use std::time::Duration;

use crate::ours::Ours;
use crate::parry::{Parry, Upkeep};
use pairmask_tests::peers::contender::Contender;
use pairmask_tests::peers::line::{PeerName, Who};
use pairmask_tests::peers::rapier::Rapier;
use pairmask_tests::prelude::*;
use pairmaskd::spawn::PrivateDaemon;
use rayon::{ThreadPool, ThreadPoolBuilder};

use crate::measure::Entrant;
use crate::options::Options;

/// How long one frame may take. No scene takes as long.
const DEADLINE: Duration = Duration::from_secs(600);
/// Time from the daemon's last poll for a frame to its sleep, with room.
const FALLING_ASLEEP: Duration = Duration::from_millis(1);

/// All contenders, ours first.
///
/// # Errors
/// A session or a thread pool that cannot be made.
pub fn entrants(
    boxes: &[Aabb],
    daemon: &PrivateDaemon,
    options: &Options,
) -> Result<Vec<Entrant>, Box<dyn std::error::Error>> {
    let mut entrants = Vec::new();
    for &threads in &options.threads {
        for &engine in &options.engine {
            for backend in [Backend::Daemon, Backend::InProcess] {
                let session = session(boxes, daemon, backend, engine, threads)?;
                let (name, rest) = match backend {
                    Backend::InProcess => ("in-process", Duration::ZERO),
                    _ => ("daemon", Duration::from_micros(options.daemon_spin_us) + FALLING_ASLEEP),
                };
                let who = Who::Ours { backend: name, engine: engine.to_string() };
                let ours = Box::new(Ours::new(session, threads, rest));
                entrants.push(Entrant::new(who, threads, ours, pool(threads)?));
            }
        }
        for &name in &options.peers {
            let pool = pool(threads)?;
            entrants.push(Entrant::new(Who::Peer(name), threads, peer(name, boxes, threads), pool));
        }
    }
    Ok(entrants)
}

fn session(
    boxes: &[Aabb],
    daemon: &PrivateDaemon,
    backend: Backend,
    engine: EngineChoice,
    threads: usize,
) -> Result<Session, ConnectError> {
    let n = u32::try_from(boxes.len()).unwrap_or(u32::MAX);
    // A frame of boxes that do not move is culled like any other, by us as by our peers.
    let builder = daemon.session().backend(backend).answer_repeats(false);
    let builder = builder.engine(engine).threads(threads);
    builder.iterate_threads(threads).deadline(DEADLINE).capacity(BoxCount::new(n)).connect()
}

/// A lane's own threads, also for one thread: the scheduler of a busy machine wakes last the thread
/// that ran most, and a shared thread would run all lanes' turns.
fn pool(threads: usize) -> Result<ThreadPool, rayon::ThreadPoolBuildError> {
    ThreadPoolBuilder::new().num_threads(threads).build()
}

fn peer(name: PeerName, boxes: &[Aabb], threads: usize) -> Box<dyn Contender> {
    match name {
        PeerName::ParryRefit => Box::new(Parry::new(boxes, Upkeep::Refit, threads)),
        PeerName::ParryOptimize => Box::new(Parry::new(boxes, Upkeep::OptimizeRefit, threads)),
        PeerName::Rapier => Box::new(Rapier::new(boxes.len())),
    }
}
