//! One shared scene: members, leases and the open tick; what is applied and answered when it ends.

use std::collections::{BTreeMap, HashSet};
use std::ops::Range;
use std::sync::Arc;
use std::time::{Duration, Instant};

use pairmask_core::dispatch::{CpuEngines, StageTimes};
use pairmask_core::engine::{CullError, EngineChoice, ReplyBuffer};
use pairmask_core::scene::shared::{
    AtEnd, Closed, Committed, Hears, LeaseError, Leases, MemberId, Ranges, TickChanges, Ticks,
};
use pairmask_core::scene::{
    Edit, EndReason, FilteredScene, SceneCopy, SceneError, SceneOptions, Step, Want,
};
use pairmask_wire::{
    AgreedTerms, JoinRequest, LeaseAction, Reject, SceneAnswerLayout, SceneName, SceneRequest,
    TickMarks, response_scene,
};

use super::Tools;
use super::member::{Commit, Member, removed_by};
use crate::clients::SceneRoom;
use crate::execute::SceneKeeper;
use crate::publish::{OpenRequest, Outbox, Refusal};

/// Boxes that a scene may hold where nobody says so.
const MOST_BOXES: u32 = 1 << 24;
/// The deadline of its ticks where nobody says so: six frames of a game.
const DEADLINE: Duration = Duration::from_millis(100);
/// Members that a scene may have.
const MOST_MEMBERS: usize = 1_024;
/// Bytes of the copy of a box, with its flags.
const BYTES_A_COPY: u64 = 25;

/// A scene that several sessions write.
pub(super) struct SharedScene {
    name: SceneName,
    terms: AgreedTerms,
    engine: EngineChoice,
    tools: Tools,
    scene: FilteredScene<SceneKeeper>,
    /// All boxes: edits are checked against it, and the scene is made again from it where a device is lost.
    copy: SceneCopy,
    room: SceneRoom,
    leases: Leases,
    ticks: Ticks,
    members: BTreeMap<MemberId, Member>,
    last_member: u64,
    has_ended: bool,
    /// Whether the scene is to be made again before it is asked.
    is_broken: bool,
}

fn new_scene(
    tools: &Tools,
    most_boxes: u32,
    engine: EngineChoice,
) -> Result<FilteredScene<SceneKeeper>, CullError> {
    let options = SceneOptions::default().with_most_boxes(most_boxes);
    let engines = CpuEngines::on(tools.isa, tools.calibration);
    Ok(FilteredScene::over(SceneKeeper::new(options, engines, tools.gpu.clone(), engine)?))
}

impl SharedScene {
    /// A scene without members, as the first one asks for it.
    pub fn begin(name: SceneName, request: &JoinRequest, tools: Tools) -> Result<Self, Refusal> {
        let asked = request.terms;
        let options = SceneOptions::default();
        let most_boxes = options.with_most_boxes(asked.most_boxes.unwrap_or(MOST_BOXES));
        let most_boxes = most_boxes.within_limits().most_boxes;
        let deadline = asked.deadline.unwrap_or(DEADLINE);
        Ok(Self {
            name,
            terms: AgreedTerms { most_boxes, deadline, at_end: asked.at_end.unwrap_or_default() },
            engine: request.engine,
            scene: new_scene(&tools, most_boxes, request.engine)?,
            copy: SceneCopy::new(most_boxes),
            room: SceneRoom::begin(&tools.memory)?,
            tools,
            leases: Leases::default(),
            ticks: Ticks::new(deadline),
            members: BTreeMap::new(),
            last_member: 0,
            has_ended: false,
            is_broken: false,
        })
    }

    pub const fn name(&self) -> &SceneName {
        &self.name
    }

    pub const fn terms(&self) -> AgreedTerms {
        self.terms
    }

    /// Whether it is no longer to be found: its last member has left.
    pub const fn has_ended(&self) -> bool {
        self.has_ended
    }

    /// Ends the scene where it has no members. Whether it has ended.
    pub fn end_without_members(&mut self) -> bool {
        self.has_ended |= self.members.is_empty();
        self.has_ended
    }

    /// When the open tick closes at the latest.
    pub const fn closes_at(&self) -> Option<Instant> {
        self.ticks.closes_at()
    }

    /// A member joins.
    pub fn join(&mut self, request: &JoinRequest) -> Result<MemberId, Refusal> {
        self.terms.agree(&request.terms)?;
        if self.members.len() >= MOST_MEMBERS {
            return Err(Reject::Edit { field: "number of members" }.into());
        }
        self.last_member += 1;
        let id = MemberId(self.last_member);
        self.members.insert(id, Member::new(request.hears));
        Ok(id)
    }

    /// A member leases indices, or gives them back with their boxes.
    pub fn lease(&mut self, id: MemberId, action: LeaseAction) -> Result<Range<u32>, Refusal> {
        let limit = self.terms.most_boxes;
        let range = match action {
            LeaseAction::Take { first, count } => {
                let end = first.checked_add(count).filter(|end| *end <= limit);
                let beyond =
                    LeaseError::BeyondLimit { end: u64::from(first) + u64::from(count), limit };
                let range = first..end.ok_or(beyond)?;
                self.leases.take(id, range.clone(), limit)?;
                range
            }
            LeaseAction::TakeAny { count } => self.leases.take_any(id, count, limit)?,
            LeaseAction::GiveBack { first } => {
                // What waits for the end of the tick may name them.
                if self.ticks.has_committed(id) {
                    return Err(Reject::Edit { field: "lease of a commit under way" }.into());
                }
                let range = self.leases.give_back(id, first)?;
                self.remove(std::slice::from_ref(&range));
                range
            }
        };
        self.ticks.wait_for(self.leases.writers());
        if let Some(member) = self.members.get_mut(&id) {
            member.own = self.leases.of(id);
            // It hears of other pairs from now on.
            if member.hears == Hears::Own {
                member.untold.lose();
            }
        }
        Ok(range)
    }

    /// A member commits. Its request is kept until the tick ends.
    ///
    /// # Errors
    /// Why not, and the request.
    #[allow(clippy::result_large_err)] // Its caller answers it at once.
    pub fn commit(
        &mut self,
        id: MemberId,
        open: OpenRequest,
        request: &SceneRequest,
        now: Instant,
    ) -> Result<(), (OpenRequest, Refusal)> {
        let request = SceneRequest { most_boxes: self.terms.most_boxes, ..*request };
        let is_first = self.leases.first_writer() == Some(id);
        let Some(member) = self.members.get(&id) else {
            return Err((open, Refusal::stale_scene(0)));
        };
        if member.revision != request.base {
            let refusal = Refusal::stale_scene(member.revision);
            return Err((open, refusal));
        }
        let wrong = |field| Refusal::from(Reject::Edit { field });
        if request.want == Want::Moved {
            return Err((open, wrong("want")));
        }
        if self.ticks.has_committed(id) {
            return Err((open, wrong("second commit of a tick")));
        }
        let mut commit = Commit::new(open, request);
        let checked = self.check(id, &mut commit, is_first);
        if let Err(refusal) = checked {
            return Err((commit.open, refusal));
        }
        if self.ticks.commit(id, now) == Committed::Twice {
            return Err((commit.open, wrong("second commit of a tick")));
        }
        if let Some(member) = self.members.get_mut(&id) {
            member.untold.acknowledge(request.is_taken);
            if request.is_lost {
                member.untold.lose();
            }
            member.revision = request.revision;
            member.commit = Some(commit);
        }
        Ok(())
    }

    /// Checks an edit alone. It stays right: nobody else changes its boxes.
    fn check(&mut self, id: MemberId, commit: &mut Commit, is_first: bool) -> Result<(), Refusal> {
        let beside = self.bytes_beside() + commit.bytes();
        let Self { members, scene, copy, room, .. } = self;
        let Some(member) = members.get(&id) else { return Ok(()) };
        let steps = commit.steps()?;
        let edit = Edit { steps: &steps };
        member.own.allow(edit, is_first)?;
        room.make_beside(scene, edit, beside + BYTES_A_COPY * edit.index_end())?;
        copy.check(edit)?;
        copy.cancel(edit);
        Ok(())
    }

    /// What is kept beside the scene.
    fn bytes_beside(&self) -> u64 {
        let members: u64 = self.members.values().map(Member::bytes).sum();
        self.copy.allocated_bytes() as u64 + members
    }

    /// Closes the open tick if that is due. What follows is to be [answered](Self::answer_tick).
    pub fn close_tick(&mut self, now: Instant) -> Option<Closed> {
        self.ticks.close(now)
    }

    /// Applies the edits of a tick that was closed, in the order of their writers' indices, and answers.
    pub fn answer_tick(&mut self, closed: &Closed, threads: usize, outbox: &Outbox) {
        let start = Instant::now();
        let mut order = self.leases.writers();
        let listeners = self.members.iter().filter(|(_, member)| member.own.is_empty());
        order.extend(listeners.map(|(id, _)| *id));
        let mut commits: Vec<(MemberId, Commit)> = order
            .into_iter()
            .filter_map(|id| Some((id, self.members.get_mut(&id)?.commit.take()?)))
            .collect();
        let late = closed.late.iter().flat_map(|id| self.leases.of(*id).as_slice().to_vec());
        let late: Ranges = late.collect();
        let mut steps = Vec::new();
        for (_, commit) in &mut commits {
            // It was read before, from the same copy.
            steps.extend(commit.steps().unwrap_or_default());
        }
        let applied = self.apply(Edit { steps: &steps }, threads);
        drop(steps);
        let needs_whole = commits.iter().any(|(id, commit)| {
            let member = self.members.get(id);
            member.is_some_and(|member| member.untold.needs_whole(commit.request.want))
        });
        let whole =
            applied.and_then(|()| if needs_whole { self.whole().map(Some) } else { Ok(None) });
        let execute_ns = start.elapsed().as_nanos() as u64;
        for (id, mut commit) in commits {
            let answered = match &whole {
                Ok(whole) => {
                    let times = StageTimes { execute_ns, ..StageTimes::default() };
                    let tick = Tick {
                        number: closed.number,
                        late: late.as_slice(),
                        whole: whole.as_ref(),
                        threads,
                        times,
                    };
                    self.answer(id, &mut commit, &tick, outbox)
                }
                Err(error) => {
                    self.lose_all();
                    Err(Refusal::from(error.clone()))
                }
            };
            if let Err(refusal) = answered {
                if let Some(member) = self.members.get_mut(&id) {
                    member.untold.lose();
                }
                outbox.refuse(&mut commit.open, &refusal);
            }
            commit.open.close();
        }
        let beside = self.bytes_beside();
        self.room.note_beside(&self.scene, beside);
    }

    /// Answers one member.
    fn answer(
        &mut self,
        id: MemberId,
        commit: &mut Commit,
        tick: &Tick<'_>,
        outbox: &Outbox,
    ) -> Result<(), Refusal> {
        let publish = Instant::now();
        let Self { members, scene, copy, .. } = self;
        let Some(member) = members.get_mut(&id) else { return Ok(()) };
        let want = commit.request.want;
        let needs_whole = member.untold.needs_whole(want);
        let whole = tick.whole.filter(|_| needs_whole).map(|whole| match member.hears {
            Hears::All => Arc::clone(whole),
            Hears::Own => {
                let heard = |pair: &[u32; 2]| member.hears_of(*pair);
                Arc::new(whole.iter().copied().filter(heard).collect())
            }
        });
        let pair_count = scene.told().pair_count().unwrap_or(0);
        let rules = scene.rules();
        let reason = |[a, b]: [u32; 2]| {
            let (a_now, b_now) = (copy.kept(a), copy.kept(b));
            let is_off = ![a_now, b_now].iter().all(|kept| kept.is_some_and(|kept| kept.is_on));
            let is_static =
                [a_now, b_now].iter().all(|kept| kept.is_some_and(|kept| kept.is_static));
            let apart = rules.is_some_and(|rules| !rules.meet(a, b));
            if is_off || is_static || apart { EndReason::Filtered } else { EndReason::Separated }
        };
        let told = member.untold.answer(want, whole, pair_count, reason);
        let layout = SceneAnswerLayout::of(&told);
        let marks = TickMarks::after(&layout, tick.number, tick.late);
        let (_, mut reply) = commit.open.parts();
        let words = reply.reserve(marks.words()).map_err(CullError::from)?;
        layout.write(&told, words);
        marks.write(tick.late, words);
        let times = StageTimes {
            publish_ns: publish.elapsed().as_nanos() as u64,
            total_ns: commit.open.taken_at().elapsed().as_nanos() as u64,
            ..tick.times
        };
        let bytes = scene.scene().bytes() + scene.rule_bytes() as u64;
        let engine = scene.scene().engine();
        let header =
            response_scene(commit.open.fields(), engine, tick.threads, &told, bytes, &times);
        outbox.answer_edit(&mut commit.open, &told, &marks.mark(header));
        member.untold.note_told(told);
        Ok(())
    }

    /// Applies an edit that was checked, and notes what all members are to be told of it.
    fn apply(&mut self, edit: Edit<'_>, threads: usize) -> Result<(), SceneError> {
        self.mend(threads)?;
        self.copy.check(edit)?;
        let more = self.copy.expand(edit);
        let steps = more.as_ref().map(|more| more.steps(edit));
        let expanded = steps.as_ref().map_or(edit, |steps| Edit { steps });
        self.scene.scene_mut().set_threads(threads);
        let edited = self.scene.edit_expanded(expanded, Want::Changes).map(drop);
        self.copy.apply(expanded);
        if edited.is_err() {
            // The boxes are in the copy.
            self.is_broken = true;
            return self.mend(threads);
        }
        let told = self.scene.told();
        if told.is_resync() {
            self.members.values_mut().for_each(|member| member.untold.lose());
        } else {
            let removed: Arc<HashSet<u32>> = Arc::new(removed_by(edit).collect());
            let changes = TickChanges {
                begun: told.begun(),
                ended: told.ended(),
                removed: &removed,
                pair_count: told.pair_count().unwrap_or(0),
            };
            for member in self.members.values_mut() {
                let Member { hears, own, untold, .. } = member;
                match hears {
                    Hears::All => untold.note(changes, |_| true),
                    Hears::Own => untold.note(changes, |[a, b]| own.has(a) || own.has(b)),
                }
            }
        }
        self.scene.take();
        Ok(())
    }

    /// Makes the scene again from the copy, where it is broken.
    fn mend(&mut self, threads: usize) -> Result<(), SceneError> {
        if !self.is_broken {
            return Ok(());
        }
        self.lose_all();
        self.scene = new_scene(&self.tools, self.terms.most_boxes, self.engine)?;
        self.scene.scene_mut().set_threads(threads);
        let whole = self.copy.whole();
        self.scene.edit_expanded(Edit { steps: &whole.steps() }, Want::All)?;
        self.scene.take();
        self.is_broken = false;
        Ok(())
    }

    /// All pairs of now.
    fn whole(&mut self) -> Result<Arc<Vec<[u32; 2]>>, SceneError> {
        match self.scene.edit_expanded(Edit::NONE, Want::All) {
            Ok(told) => {
                let pairs = Arc::new(told.pairs().to_vec());
                self.scene.take();
                Ok(pairs)
            }
            Err(error) => {
                self.is_broken = true;
                Err(error)
            }
        }
    }

    fn lose_all(&mut self) {
        self.members.values_mut().for_each(|member| member.untold.lose());
    }

    /// A member has left, or its session is gone. Returns the request of a commit that has no answer.
    pub fn end_member(&mut self, id: MemberId) -> Option<OpenRequest> {
        let member = self.members.remove(&id)?;
        self.ticks.forget(id);
        let ended = self.leases.end(id);
        self.ticks.wait_for(self.leases.writers());
        if self.terms.at_end == AtEnd::Remove && !self.members.is_empty() {
            self.remove(&ended);
        }
        member.commit.map(|commit| commit.open)
    }

    /// Removes the boxes of ranges that are nobody's any more.
    fn remove(&mut self, ranges: &[Range<u32>]) {
        let end = self.copy.index_end() as u32;
        let indices = ranges.iter().flat_map(|range| range.start..range.end.min(end));
        let present: Vec<u32> = indices.filter(|index| self.copy.get(*index).is_some()).collect();
        if present.is_empty() {
            return;
        }
        let steps = [Step::Remove((&present).into())];
        if let Err(error) = self.apply(Edit { steps: &steps }, 1) {
            log::warn!("scene '{}': removing boxes of a member that is gone: {error}", self.name);
        }
    }
}

/// A tick as all its members are told of it.
struct Tick<'a> {
    number: u64,
    late: &'a [Range<u32>],
    whole: Option<&'a Arc<Vec<[u32; 2]>>>,
    threads: usize,
    times: StageTimes,
}
