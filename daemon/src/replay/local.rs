//! A session of a recording, answered by this process as a session with `Backend::InProcess` is.
//!
//! Frames go through such a session. Scenes are those that it keeps (`core/scene`), without the session around them: a
//! recorded edit says whether the answer before was acknowledged, which a session does by itself.

use std::collections::HashMap;
use std::time::{Duration, Instant};

use pairmask::{Backend, ConnectError, Error, FrameOptions, PairMask, Session};
use pairmask_core::cast::Hit;
use pairmask_core::dispatch::CpuEngines;
use pairmask_core::engine::{AvailableIsa, EngineId};
use pairmask_core::plan::Calibration;
use pairmask_core::scene::{Cast, Edit, Scene, SceneOptions};
use pairmask_core::{EncodingChoice, EngineChoice, EngineName};
use pairmask_wire::{
    CastRequest, CullRequest, EditScratch, Page, QueryRequest, Reject, Request, SceneId,
    SceneRequest, StatusCode,
};

use crate::publish::Refusal;
use crate::recording::{Answered, Asked, Entry, FrameReader, Set};

/// Hits of all shapes of a cast together: more than a recorded answer of the largest size has.
const MOST_HITS: u64 = 1 << 26;

/// Engines and scenes of one session.
pub(super) struct LocalSession {
    isa: AvailableIsa,
    frames: FrameReader,
    /// A session has one engine, encoding and number of threads.
    session: Option<(Settings, Session)>,
    scenes: HashMap<SceneId, LocalScene>,
}

type Settings = (EngineChoice, EncodingChoice, Option<usize>);

struct LocalScene {
    revision: u64,
    scene: Scene,
}

/// Why this process has another answer than the one that a daemon gives.
enum Refused {
    Status(StatusCode),
    /// What a session says that no daemon says.
    Connect(ConnectError),
}

impl<E: Into<Refusal>> From<E> for Refused {
    fn from(error: E) -> Self {
        Self::Status(error.into().status())
    }
}

/// What was found, as it is iterated over after the clock has stopped.
enum Found {
    Mask(Box<PairMask>),
    Pairs {
        pairs: Vec<[u32; 2]>,
        queries: u32,
    },
    Hits(Vec<Hit>),
    /// What the scene has reported.
    Reported(SceneId),
    Nothing,
}

impl LocalSession {
    pub fn new(isa: AvailableIsa) -> Self {
        let (frames, scenes) = (FrameReader::default(), HashMap::new());
        Self { isa, frames, session: None, scenes }
    }

    /// The answer to a request, and what it took. `None` to one of a shared scene, which needs a daemon.
    pub fn answer(
        &mut self,
        request: &Request,
        pages: &[Page],
        each: impl FnMut(Entry),
    ) -> Result<Option<(Answered, Duration)>, ConnectError> {
        let begun = Instant::now();
        let done = match request {
            Request::Cull(request) => self.frame(request, pages),
            Request::EditScene(request) => self.edit(request, pages),
            Request::QueryScene(request) if request.revision.is_none() => return Ok(None),
            Request::CastScene(request) if request.revision.is_none() => return Ok(None),
            Request::QueryScene(request) => self.query(request, pages),
            Request::CastScene(request) => self.cast(request, pages),
            Request::EndScene(scene) => {
                self.scenes.remove(scene);
                Ok((EngineName::CpuGrid as u32, Found::Nothing))
            }
            Request::JoinShared(_)
            | Request::LeaseShared(_)
            | Request::CommitShared(_)
            | Request::ObserveShared(_)
            | Request::LeaveShared(_)
            | Request::Status => return Ok(None),
        };
        let took = begun.elapsed();
        let (status, engine, found) = match done {
            Ok((engine, found)) => (StatusCode::Ok, engine, found),
            Err(Refused::Status(status)) => (status, 0, Found::Nothing),
            Err(Refused::Connect(error)) => return Err(error),
        };
        let mut answered = Answered {
            status: status as u32,
            engine,
            total_ns: took.as_nanos() as u64,
            ..Answered::default()
        };
        answered.note_all(each, |note| self.read(&found, note));
        Ok(Some((answered, took)))
    }

    fn read(&self, found: &Found, note: &mut dyn FnMut(Entry)) {
        match found {
            Found::Mask(mask) => mask.for_each(|a, b| note(Set::Pairs.entry([a, b, 0]))),
            Found::Pairs { pairs, queries } => {
                // The mask of a query has its queries before the boxes.
                for [query, index] in pairs {
                    note(Set::Pairs.entry([*query, index.wrapping_add(*queries), 0]));
                }
            }
            Found::Hits(hits) => hits.iter().for_each(|hit| {
                note(Set::Hits.entry([hit.query, hit.index, hit.distance.to_bits()]));
            }),
            Found::Reported(id) => {
                if let Some(kept) = self.scenes.get(id) {
                    let reported = kept.scene.reported();
                    reported.begun().iter().for_each(|[a, b]| note(Set::Begun.entry([*a, *b, 0])));
                    for ended in reported.ended() {
                        let [a, b] = ended.pair;
                        note(Set::Ended.entry([a, b, ended.reason as u32]));
                    }
                    reported.pairs().iter().for_each(|[a, b]| note(Set::Pairs.entry([*a, *b, 0])));
                    if reported.is_resync() {
                        note(Set::Resync.entry([0; 3]));
                    }
                }
            }
            Found::Nothing => {}
        }
    }

    fn frame(&mut self, request: &CullRequest, pages: &[Page]) -> Result<(u32, Found), Refused> {
        let asked = self.frames.read(request, pages)?;
        let settings = (request.engine, request.encoding, request.threads);
        if self.session.as_ref().is_none_or(|(last, _)| *last != settings) {
            self.session = Some((settings, self.connect(settings).map_err(Refused::Connect)?));
        }
        let Some((_, session)) = &mut self.session else {
            return Err(Refused::Status(StatusCode::EngineFailed));
        };
        let options = FrameOptions { filters: asked.filters, split_at: asked.split_at };
        let mask = match &asked.objects {
            Asked::Boxes(boxes) => session.frame(boxes.len()).and_then(|mut frame| {
                frame.write(boxes)?;
                frame.submit_with(&options)?.wait()
            }),
            Asked::Spheres(spheres) => session.sphere_frame(spheres.len()).and_then(|mut frame| {
                frame.spheres_mut().copy_from_slice(spheres);
                frame.submit()?.wait()
            }),
        };
        match mask {
            Ok(mask) => {
                let engine = match mask.info().engine {
                    EngineId::Known(name) => name as u32,
                    EngineId::Unknown(number) => number,
                };
                Ok((engine, Found::Mask(Box::new(mask))))
            }
            Err(Error::Cull(error)) => Err(error.into()),
            Err(_) => Err(Refused::Status(StatusCode::EngineFailed)),
        }
    }

    fn connect(&self, (engine, encoding, threads): Settings) -> Result<Session, ConnectError> {
        let builder = Session::builder().backend(Backend::InProcess).isa(self.isa);
        // The engines of a GPU are a daemon's.
        let engine = match engine {
            EngineChoice::Only(name) if name.is_gpu() => EngineChoice::Auto,
            engine => engine,
        };
        let builder = builder.engine(engine).encoding(encoding);
        match threads {
            Some(threads) => builder.threads(threads),
            None => builder,
        }
        .connect()
    }

    fn edit(&mut self, request: &SceneRequest, pages: &[Page]) -> Result<(u32, Found), Refused> {
        if request.base == 0 {
            let options = SceneOptions::default().with_most_boxes(request.most_boxes);
            let engines = CpuEngines::on(self.isa, Calibration::built_in(self.isa.get()));
            let scene = Scene::with_engines(options, engines);
            self.scenes.insert(request.scene, LocalScene { revision: 0, scene });
        }
        let kept = find(&mut self.scenes, request.scene, request.base)?;
        let mut scratch = EditScratch::default();
        let steps = scratch.read(request, pages)?;
        if request.is_acknowledged {
            kept.scene.acknowledge();
        }
        if request.is_lost {
            kept.scene.resync();
        }
        kept.scene.set_threads(request.threads);
        kept.scene.edit(Edit { steps: &steps }, request.report)?;
        kept.revision = request.revision;
        if let Some(pair_count) = request.reported {
            kept.scene.mark_reported(pair_count);
        }
        Ok((EngineName::CpuGrid as u32, Found::Reported(request.scene)))
    }

    fn query(&mut self, request: &QueryRequest, pages: &[Page]) -> Result<(u32, Found), Refused> {
        let kept = find(&mut self.scenes, request.scene, request.revision.unwrap_or(0))?;
        let (boxes, filter_data) = request.read(pages).ok_or(Reject::Query("payload"))?;
        let (mut pairs, queries) = (Vec::new(), request.mask.queries());
        kept.scene.query(boxes, filter_data, &mut pairs).map_err(|_| refused_query())?;
        Ok((EngineName::CpuGrid as u32, Found::Pairs { pairs, queries }))
    }

    fn cast(&mut self, request: &CastRequest, pages: &[Page]) -> Result<(u32, Found), Refused> {
        let kept = find(&mut self.scenes, request.scene, request.revision.unwrap_or(0))?;
        let (shapes, filter_data) = request.read(pages).ok_or(Reject::Query("payload"))?;
        let cast = Cast { shapes, hits: request.hits, filter_data, most_hits: MOST_HITS };
        let mut hits = Vec::new();
        kept.scene.cast(&cast, &mut hits).map_err(|_| refused_query())?;
        Ok((EngineName::CpuGrid as u32, Found::Hits(hits)))
    }
}

/// A query that is wrong was refused by its header.
const fn refused_query() -> Refused {
    Refused::Status(StatusCode::EngineFailed)
}

fn find(
    scenes: &mut HashMap<SceneId, LocalScene>,
    id: SceneId,
    revision: u64,
) -> Result<&mut LocalScene, Refused> {
    let kept = scenes.get_mut(&id).filter(|kept| kept.revision == revision);
    kept.ok_or(Refused::Status(StatusCode::StaleScene))
}
