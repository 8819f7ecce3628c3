//! Requests of a client.

use pairmask_core::engine::EngineChoice;
use pairmask_core::mask::{Encoding, EncodingChoice};
use pairmask_core::objects::{ObjectForm, Objects};
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;

use crate::header::{Operation, RequestHeader, engine_number, thread_number, threads_of};
use crate::page::Page;
use crate::reject::Reject;
use crate::rules::{PARTS, RulesSections};
use crate::scene::{
    CastRequest, JoinRequest, LeaseRequest, ObserveRequest, QueryRequest, SceneId, SceneRequest,
};
use crate::section::{SECTION_COUNT, Section, SectionKind, has, slots};
use crate::{REQUEST_MAGIC, VERSION_MAJOR};

/// Where the objects of a scene lie in a payload, and what they are. What else each object has for all
/// engines to honour belongs here: its place, its section, and what [`SceneSections::objects_in`] makes of
/// it.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SceneSections {
    /// Boxes or spheres, and their form.
    pub form: ObjectForm,
    /// How many.
    pub count: BoxCount,
    /// Offset of the objects in the payload, bytes; `form.bytes(count)` bytes from there are within
    /// a payload that the place was validated against.
    pub offset: usize,
}

impl SceneSections {
    /// No boxes.
    pub const EMPTY: Self =
        Self { form: ObjectForm::Boxes(BoxForm::F32), count: BoxCount::new(0), offset: 0 };

    /// `count` objects of a form at the start of a payload.
    pub fn first(form: impl Into<ObjectForm>, count: BoxCount) -> Self {
        Self { form: form.into(), count, offset: 0 }
    }

    /// Bytes of a payload that holds the scene.
    pub const fn payload_bytes(self) -> u64 {
        self.offset as u64 + self.form.bytes(self.count)
    }

    /// The section that says so in a header.
    fn section(self) -> Section {
        let (kind, bytes) = (SectionKind::of(self.form), self.form.bytes(self.count));
        Section::required(kind, self.offset as u64, bytes)
    }

    /// The objects, or `None` where they are not all in the payload.
    pub fn objects_in(self, pages: &[Page]) -> Option<Objects<'_>> {
        Objects::new(self.form, self.section().bytes_in(pages)?)
    }
}

/// A request for the pairs of a scene: what a client says in a header, and what a daemon has validated
/// of one.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct CullRequest {
    /// The scene.
    pub scene: SceneSections,
    /// The rules of which boxes may meet; `None` where all may, or where they are kept.
    pub rules: Option<RulesSections>,
    /// The number under which the daemon keeps the rules of the request, or without rules in the request
    /// the number of those that it keeps. 0 for rules that are not kept.
    pub rules_number: u64,
    /// The engine asked for.
    pub engine: EngineChoice,
    /// The encoding asked for.
    pub encoding: EncodingChoice,
    /// Threads that the engine may use; `None` leaves the number to the plan.
    pub threads: Option<usize>,
    /// Threads with which the client iterates over the pairs, for the plan; `None` is one.
    pub iterate_threads: Option<usize>,
    /// Whether a frame that is equal to the last one may get that one's answer, without an engine.
    pub may_repeat: bool,
    /// The first so many boxes are a set, the others another one, and only pairs of a box of each count;
    /// `None` where all pairs do.
    pub first_set: Option<BoxCount>,
}

impl CullRequest {
    /// A request of this build that leaves all choices to the plan.
    pub const fn of(scene: SceneSections) -> Self {
        Self {
            scene,
            rules: None,
            rules_number: 0,
            engine: EngineChoice::Auto,
            encoding: EncodingChoice::Auto,
            threads: None,
            iterate_threads: None,
            may_repeat: true,
            first_set: None,
        }
    }
}

/// A validated request.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Request {
    /// Find pairs.
    Cull(CullRequest),
    /// Report the status.
    Status,
    /// Change a scene.
    EditScene(SceneRequest),
    /// End a scene.
    EndScene(SceneId),
    /// Find the boxes of a scene that other boxes overlap.
    QueryScene(QueryRequest),
    /// Find the boxes of a scene that rays hit or spheres touch.
    CastScene(CastRequest),
    /// Join a shared scene.
    JoinShared(JoinRequest),
    /// Lease indices of a shared scene, or give them back.
    LeaseShared(LeaseRequest),
    /// Change one's boxes of a shared scene.
    CommitShared(SceneRequest),
    /// Leave a shared scene.
    LeaveShared(SceneId),
    /// Report which boxes of a shared scene changed.
    ObserveShared(ObserveRequest),
}

/// Flag of a cull: an engine finds the pairs, also where the frame is equal to the last one.
const CULL_ANEW: u32 = 1;

impl RequestHeader {
    /// A request to cull a scene, with what the client asks for.
    pub fn cull(client_token: u64, frame: u64, request: &CullRequest) -> Self {
        let scene = request.scene;
        let rules = request.rules.unwrap_or_default();
        let are_kept = request.rules.is_none() && request.rules_number != 0;
        let kept = are_kept.then(|| Section::required(SectionKind::CachedRules, 0, 0));
        let sections = [scene.section()].into_iter().chain(rules.sections()).chain(kept);
        let operation =
            if request.first_set.is_some() { Operation::CullBetween } else { Operation::Cull };
        Self {
            flags: if request.may_repeat { 0 } else { CULL_ANEW },
            box_count: scene.count.get(),
            engine: engine_number(request.engine),
            encoding: match request.encoding {
                EncodingChoice::Auto => 0,
                EncodingChoice::Only(encoding) => encoding as u32,
            },
            threads: thread_number(request.threads),
            iterate_threads: thread_number(request.iterate_threads),
            sections: slots(sections),
            revision: request.rules_number,
            most_boxes: request.first_set.map_or(0, BoxCount::get),
            ..Self::envelope(operation, client_token, frame)
        }
    }

    /// A request for the daemon's status.
    pub fn status(client_token: u64, frame: u64) -> Self {
        Self::envelope(Operation::Status, client_token, frame)
    }
}

impl Request {
    /// Checks a copied header against the payload's length.
    ///
    /// # Errors
    /// [`Reject`] with the first field that is wrong.
    pub fn parse(header: &RequestHeader, payload_bytes: u64) -> Result<Self, Reject> {
        if header.magic != REQUEST_MAGIC {
            return Err(Reject::Magic(header.magic));
        }
        if header.version_major != VERSION_MAJOR {
            return Err(Reject::Version(header.version()));
        }
        let unknown = |s: &&Section| {
            s.is_used() && s.flags & Section::REQUIRED != 0 && !is_known(s, header.operation)
        };
        if let Some(section) = header.sections.iter().find(unknown) {
            return Err(Reject::UnknownSection(section.kind));
        }
        let unknown = Reject::Operation(header.operation);
        let scene = SceneId(header.scene);
        match bytemuck::checked::try_cast(header.operation).map_err(|_| unknown)? {
            Operation::Status => Ok(Self::Status),
            Operation::Cull => Self::parse_cull(header, None, payload_bytes),
            Operation::CullBetween => {
                let first = BoxCount::new(header.most_boxes);
                Self::parse_cull(header, Some(first), payload_bytes)
            }
            Operation::EditScene => SceneRequest::parse(header, payload_bytes).map(Self::EditScene),
            Operation::QueryScene => {
                QueryRequest::parse(header, payload_bytes).map(Self::QueryScene)
            }
            Operation::CastScene => CastRequest::parse(header, payload_bytes).map(Self::CastScene),
            Operation::EndScene => Ok(Self::EndScene(scene)),
            Operation::JoinShared => {
                JoinRequest::parse(header, payload_bytes).map(Self::JoinShared)
            }
            Operation::LeaseShared => LeaseRequest::parse(header).map(Self::LeaseShared),
            Operation::CommitShared => {
                SceneRequest::parse(header, payload_bytes).map(Self::CommitShared)
            }
            Operation::LeaveShared => Ok(Self::LeaveShared(scene)),
            Operation::ObserveShared => Ok(Self::ObserveShared(ObserveRequest::parse(header))),
        }
    }

    fn parse_cull(
        header: &RequestHeader,
        first_set: Option<BoxCount>,
        payload_bytes: u64,
    ) -> Result<Self, Reject> {
        let engine = header.engine_choice()?;
        let encoding = match header.encoding {
            0 => EncodingChoice::Auto,
            found => {
                EncodingChoice::Only(Encoding::from_wire(found).ok_or(Reject::Encoding(found))?)
            }
        };
        let box_count = BoxCount::new(header.box_count);
        let wrong = Reject::Objects { box_count: header.box_count, payload_bytes };
        let (form, section) = find_objects(&header.sections).ok_or(wrong)?;
        if section.bytes != form.bytes(box_count) || !section.fits(payload_bytes) {
            return Err(wrong);
        }
        let offset = usize::try_from(section.offset).map_err(|_| wrong)?;
        let rules = RulesSections::find(&header.sections, box_count, payload_bytes)?;
        let are_kept = has(&header.sections, SectionKind::CachedRules);
        let has_rules = rules.is_some() || are_kept;
        let rules_number = if has_rules { header.revision } else { 0 };
        if are_kept && (rules.is_some() || rules_number == 0) {
            return Err(Reject::Rules("number"));
        }
        let are_spheres = form == ObjectForm::Spheres;
        if has_rules && are_spheres {
            return Err(Reject::Rules("form of objects"));
        }
        if let Some(first) = first_set {
            let wrong =
                [(are_spheres, "form"), (has_rules, "rules"), (first > box_count, "first set")];
            if let Some((_, field)) = wrong.into_iter().find(|(is_wrong, _)| *is_wrong) {
                return Err(Reject::Query(field));
            }
        }
        Ok(Self::Cull(CullRequest {
            scene: SceneSections { form, count: box_count, offset },
            rules,
            rules_number,
            engine,
            encoding,
            threads: threads_of(header.threads),
            iterate_threads: threads_of(header.iterate_threads),
            may_repeat: header.flags & CULL_ANEW == 0,
            first_set,
        }))
    }
}

/// Whether a section is of a kind that an operation knows.
fn is_known(section: &Section, operation: u32) -> bool {
    let is_one_of = |operations: &[Operation]| operations.iter().any(|o| *o as u32 == operation);
    let is_of = |kinds: &[SectionKind]| kinds.iter().any(|kind| *kind as u32 == section.kind);
    form_of(section).is_some()
        || is_one_of(&[Operation::Cull])
            && (is_of(&PARTS.map(|(kind, ..)| kind)) || is_of(&[SectionKind::CachedRules]))
        || is_one_of(&[Operation::EditScene, Operation::CommitShared])
            && is_of(&[SectionKind::SceneSteps, SectionKind::SceneIndices])
        || is_one_of(&[Operation::QueryScene, Operation::CastScene])
            && is_of(&[SectionKind::QueryFilterData])
        || is_one_of(&[Operation::CastScene]) && is_of(&[SectionKind::Rays])
        || is_one_of(&[Operation::JoinShared]) && is_of(&[SectionKind::SceneName])
}

/// The form of the objects in a section, or `None` where it holds no objects.
fn form_of(section: &Section) -> Option<ObjectForm> {
    ObjectForm::ALL.into_iter().find(|form| SectionKind::of(*form) as u32 == section.kind)
}

/// The one section of boxes or spheres, or `None` where there is none, or more than one in any
/// forms.
fn find_objects(sections: &[Section; SECTION_COUNT]) -> Option<(ObjectForm, Section)> {
    let mut found = sections.iter().filter_map(|s| Some((form_of(s)?, *s)));
    let first = found.next()?;
    found.next().is_none().then_some(first)
}
