//! Which session for which game: what to send, what to ask for, what to keep.
//!
//! # By what moves
//!
//! | boxes | call | sent a frame | answer |
//! |---|---|---|---|
//! | most of them move | [`Session::frame`] | all, 24 bytes a box | all pairs |
//! | most move, the bytes are the bottleneck, extra pairs do no harm | [`Session::narrow_frame`] | all, 12 or 6 bytes | all pairs, and some that are near |
//! | bounding spheres, or circles in a plane | [`Session::sphere_frame`] | all, 16 bytes | all pairs, exact |
//! | few of many move, or you need what began and ended | [`Session::scene`] | those that changed | as the [report](Report) says |
//! | many or all move a little, some far | [`Session::scene`] with margins | those that left their [margin](#margins-a-box) | the same, of near or of exact pairs |
//! | several processes write one world | [`Session::join_scene`]: each leases indices and commits its own boxes, tick by tick | those that changed | changes of its own pairs, or of all |
//!
//! * A frame looks at every box. Its time does not depend on how many of them moved, unless none did: a
//!   frame that is equal to the last one, bit by bit, costs a comparison.
//! * A scene looks at what changed while that is little. Beyond, it searches all boxes, as a frame does, and
//!   compares besides ([How](crate::scene#how)). Ask a frame if most boxes move in most frames and you
//!   need all pairs anyway.
//! * A scene holds exact boxes. It has no narrow forms and no spheres.
//! * Where a few boxes move far and others jitter, take a scene whose boxes have [margins](#margins-a-box).
//! * Narrow forms save time where boxes cross the link to a GPU. CPU engines expand them first: there they
//!   save bytes and no time. Spheres are culled by cores and by a GPU.
//! * `cargo bench --bench skip` of the repository times scenes beside frames on your machine, by the share
//!   of boxes that move.
//!
//! # By game
//!
//! | game | session | report |
//! |---|---|---|
//! | A shooter: 5,000 props, 200 of them move | a scene. Props that lie on the ground are not sent. Level geometry is static | [`Report::Changes`]: [contacts](#contacts) live between frames |
//! | A physics sandbox in which everything falls | a scene if boxes come to rest and sleep, as in the example `falling_boxes`; else frames | [`Report::Changes`] |
//! | A particle system, a fluid: all move, always | frames, narrow ones where near pairs do no harm | |
//! | A strategy game: 50,000 units, most of them marching | sphere frames: spheres with one height are circles, decided exactly, on cores and on a GPU | |
//! | The same, most of them standing | a scene, in which only marching units are set | [`Report::Moved`] to part units; [`Report::Changes`] for who came into range |
//! | A city: static buildings, traffic | a scene. [Buildings are static](#static-worlds-and-traffic), and are set and removed by blocks | [`Report::Moved`] |
//! | Projectiles, pickups: spawned and gone in great number | a scene with a [pool of indices](#pools-and-answers-that-nobody-waits-for) that are switched off | [`Report::Changes`] |
//! | Trigger volumes: who came in, who left | a scene. Triggers are static, if they need not meet one another | [`Report::Changes`] |
//! | Reinforcement learning: thousands of small worlds in step | one frame of all worlds, each box with the [tag](crate::filters::Tag) of its world: [`FrameOptions::filters`](crate::FrameOptions::filters) | all pairs, [world by world](crate::PairMask::pairs_of_world) |
//! | Bullets, cameras, triggers that are asked now and then: many boxes against a large world | a scene, and [queries](crate::Scene::query) of it: boxes, points ([`Aabb::point`](crate::Aabb::point)) and sweeps ([`Aabb::swept`](crate::Aabb::swept)), which cost by what they find | [`Report::Nothing`] |
//! | Players against scenery: a few against many | a frame, [`FrameOptions::split_at`](crate::FrameOptions::split_at) | |
//! | A level editor | a scene; hidden layers are switched off | [`Report::Moved`]: what the dragged object touches now |
//! | A server with several processes | a daemon, and a session in each process. A scene belongs to its session; one that several write is [joined](Session::join_scene) by name | any |
//! | A tool that looks at a level once | a frame, [`Backend::InProcess`] | |
//!
//! # Who answers
//!
//! Pairs do not depend on it, and a scene's answers are the same bytes.
//!
//! * [`Backend::Auto`], for whatever you ship. It takes the daemon where one serves. It answers in this
//!   process where none does, or where one dies, and goes back to the daemon by itself.
//! * [`Backend::InProcess`], for a few hundred boxes, tests, tools, and platforms without a daemon. Going
//!   to a daemon adds [2 µs while both sides spin and 39 where they sleep](#records). In process 64 boxes
//!   take 2 µs in all.
//! * [`Backend::Daemon`], where this process must not spend its own cores or memory on pairs, and for
//!   measurements. What `Auto` answers in process is an error here.
//!
//! A daemon learns when the next frame of a steady client is due, and is awake then. So is a session that answers
//! in process with several threads: a thread of its own calls some threads of your pool shortly before, which would
//! wake one after the other, 50 to 100 µs each on a virtual machine. Your own work in the pool goes first, and
//! waits for a called thread 10 µs at most. It is done for frames from outside of the pool, at steady rates up to
//! some hundred a second. Keep a pool awake all the time with an [`AwakePool`](crate::mask::AwakePool) where it
//! has nothing else to do.
//!
//! A daemon serves 16 clients unless `pairmaskd serve --max-clients` says otherwise. They share its cores
//! and its GPU. Eight clients of 1,000 boxes get a frame in [72 to 79 µs](#records) on 16 cores.
//!
//! # What to send
//!
//! * Send the boxes that changed since your last edit, and no others. A box is set by its index:
//!   [`SceneEdit::set`] one by one, [`SceneEdit::set_all`] where boxes lie in an array,
//!   [`SceneEdit::set_with`] where a function computes them.
//! * Name adjacent indices as a range. A list has 4 bytes an index, a
//!   [bitmask](crate::scene::Indices::Mask) one bit for each index of its span: it has fewer bytes where
//!   more than one in 32 is named.
//! * A box that is set to the very bits that it has costs its bytes, and nothing is searched around it.
//!   [`Report::Moved`] counts it as moved.
//! * Boxes that physics pushes after the answer have moved. Send them with the next edit, also those that fall
//!   asleep before it.
//! * Boxes that jitter: give them [margins](#margins-a-box).
//! * Worlds in f64: [`Aabb::outward_from_f64`], relative to an origin that stays. A new origin changes
//!   every box.
//! * An edit is applied as a whole or not at all. Removals go first, then sets, then flags.
//! * An edit without steps is allowed: it asks, and changes nothing.
//!
//! # What to report
//!
//! * [`Report::Changes`]: pairs that began and ended since the last answer that was waited for. You keep the pairs.
//! * [`Report::Moved`]: all pairs of the boxes that this edit names. You keep nothing. No ends are reported.
//! * [`Report::All`]: all pairs. You keep nothing. It costs what a frame costs, unless nothing has changed
//!   since the last one.
//! * [`Report::Nothing`]: loading, and ticks whose pairs you do not need. What it changes is reported later.
//!
//! Each edit may ask for something else. A game may ask for [`Report::Moved`] in each tick of its physics, and
//! ten times a second for [`Report::Changes`], for its triggers: a pair that began and ended again between
//! two answers is not reported.
//!
//! # When to wait
//!
//! * An answer that was waited for counts as received. The next changes are counted from it: apply those of
//!   [`Report::Changes`] to your contacts, and let [`Report::All`] replace them.
//! * Waiting for [`Report::Moved`] or [`Report::Nothing`] changes nothing of that.
//! * An answer that is lost or never waited for is not received. Its edit is applied all the same, and the next
//!   answer makes up for it: each change is reported exactly once.
//! * A [`SceneEdit`] that is dropped before [`commit`](SceneEdit::commit) changes nothing.
//! * A daemon's answer holds one of a session's three places for frames until it is dropped.
//!
//! # What to keep
//!
//! A map from pairs to whatever you know of them: impulses, ages, sounds. Pairs have the smaller index
//! first, and lists are sorted, so that a sorted map goes through them in the same order everywhere.
//!
//! * Remove what [ended](SceneAnswer::ended) before you insert what [began](SceneAnswer::begun): a pair
//!   whose index was given to a new box may be in both.
//! * At a [resync](SceneAnswer::is_resync), [`pairs`](SceneAnswer::pairs) is the whole set. Drop the
//!   contacts that are not in it and begin those that are missing. Contacts in both go on.
//! * A resync does not say which boxes were removed. Drop the contacts of a box when you remove it, and
//!   ignore the end of a pair that you no longer have.
//! * A resync comes when there are more changes than pairs (and more than 4,096), when a daemon has lost
//!   the scene or another process answers, and after [`Scene::resync`].
//! * Call [`Scene::resync`] when your own contacts are lost, as after loading a saved game.
//!
//! # Contacts
//!
//! ```
//! use std::collections::{BTreeMap, BTreeSet};
//!
//! use pairmask::scene::{SceneOptions, Report};
//! use pairmask::{Aabb, SceneAnswer, Session};
//!
//! /// What the game knows of two boxes that touch.
//! #[derive(Debug, Default)]
//! struct Contact {
//!     impulse: f32,
//! }
//!
//! type Contacts = BTreeMap<[u32; 2], Contact>;
//!
//! fn update(contacts: &mut Contacts, answer: &SceneAnswer<'_>) {
//!     if answer.is_resync() {
//!         let now: BTreeSet<[u32; 2]> = answer.pairs().iter().collect();
//!         contacts.retain(|pair, _| now.contains(pair));
//!         for pair in now {
//!             contacts.entry(pair).or_default();
//!         }
//!     } else {
//!         for ended in answer.ended() {
//!             contacts.remove(&ended.pair);
//!         }
//!         for pair in answer.begun() {
//!             contacts.insert(pair, Contact::default());
//!         }
//!     }
//! }
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut session = Session::builder().connect()?;
//! let mut scene = session.scene(SceneOptions::default());
//! let mut contacts = Contacts::new();
//! let crate_at = |x: f32| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
//!
//! // 5,000 crates in a row, none of which touch.
//! let crates: Vec<Aabb> = (0..5_000).map(|i| crate_at(2.0 * i as f32)).collect();
//! update(&mut contacts, &scene.edit().set_all(0..5_000, &crates).commit(Report::Changes)?);
//! assert!(contacts.is_empty());
//!
//! // Two of them are pushed. The others are not sent.
//! let edit = scene.edit().set(7, crate_at(15.5)).set(20, crate_at(41.25));
//! update(&mut contacts, &edit.commit(Report::Changes)?);
//! assert!(contacts.keys().eq(&[[7, 8], [20, 21]]));
//! contacts.insert([7, 8], Contact { impulse: 3.0 });
//!
//! // A resync: contacts that go on stay what they are.
//! scene.resync();
//! let answer = scene.edit().set(20, crate_at(40.0)).commit(Report::Changes)?;
//! assert!(answer.is_resync());
//! update(&mut contacts, &answer);
//! assert!(contacts.len() == 1 && contacts[&[7, 8]].impulse == 3.0);
//! # Ok(())
//! # }
//! ```
//!
//! The example `falling_boxes` of the repository is this as a program, with boxes that sleep.
//!
//! # Margins a box
//!
//! A scene whose [options](crate::scene::SceneOptions) have margins sends boxes that are inflated, each by the usual
//! margin or by its own. You set all boxes that moved. What lies within its inflated self is not sent, and an edit that sends nothing asks
//! nobody.
//!
//! * [`MarginedPairs::Near`]: pairs of the inflated boxes. They live longer than overlaps, as physics engines
//!   want their pair caches; test each with the boxes of now where it matters ([`Aabb::overlaps`]).
//! * [`MarginedPairs::Exact`]: what a scene of the boxes themselves tells, bit by bit. This process tests the
//!   near pairs around the boxes that you set. Where nothing leaves its margin that takes about as long as
//!   plain scenes in process take to find the changes; it saves the request, and the daemon's time.
//! * A large margin sends fewer boxes and finds more near pairs. Take what a box moves in 10 to 30 frames,
//!   and no margin for what rests or teleports.
//! * Boxes that leave their margin in each frame cost more than in a plain scene.
//!
//! ```
//! use pairmask::scene::{MarginedPairs, SceneOptions, Report};
//! use pairmask::{Aabb, Margin, Session};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut session = Session::builder().connect()?;
//! let margin = Margin::new(0.25)?;
//! let options = SceneOptions::default().with_margins(MarginedPairs::Exact, margin);
//! let mut scene = session.scene(options);
//! let at = |x: f32| Aabb::new([x, 0.0, 0.0], [x + 1.0, 1.0, 1.0]);
//!
//! // A row of 1,000 that sway, 1.125 units apart. One of them teleports in each frame.
//! let mut row: Vec<Aabb> = (0..1_000).map(|i| at(1.125 * i as f32)).collect();
//! drop(scene.edit().set_all(0..1_000, &row).commit(Report::Changes)?);
//! for frame in 0..16 {
//!     let sway = if frame % 2 == 0 { 0.125 } else { 0.0 };
//!     for (i, b) in row.iter_mut().enumerate().skip(1).step_by(2) {
//!         *b = at(1.125 * i as f32 + sway);
//!     }
//!     row[0] = at(2_000.0 + frame as f32);
//!     let answer = scene.edit().set_all(0..1_000, &row).commit(Report::Changes)?;
//!     let touch = if frame % 2 == 0 { answer.begun().len() } else { answer.ended().len() };
//!     assert_eq!(touch, 499, "each that sways with the one to its right");
//! }
//! // Of 17,000 boxes set.
//! assert_eq!(scene.margin_stats().expect("it has margins").sent, 1_016);
//! # Ok(())
//! # }
//! ```
//!
//! # Static worlds and traffic
//!
//! ```
//! use pairmask::scene::{SceneOptions, Report};
//! use pairmask::{Aabb, Session};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut session = Session::builder().connect()?;
//! let mut city = session.scene(SceneOptions::default());
//!
//! // A block is loaded: 100 houses, wall to wall. Two static boxes are no pair.
//! let house = |i: u32| Aabb::new([10.0 * i as f32, 0.0, 0.0], [10.0 * (i + 1) as f32, 20.0, 10.0]);
//! let houses: Vec<Aabb> = (0..100).map(house).collect();
//! let edit = city.edit().set_all(0..100, &houses).make_all_static(0..100, true);
//! drop(edit.commit(Report::Nothing)?);
//!
//! // Cars are set in each frame, and asked for.
//! let car = |x: f32| Aabb::new([x, 0.0, 9.0], [x + 4.0, 1.5, 11.0]);
//! let cars = [car(3.0), car(252.0), car(255.0)];
//! let answer = city.edit().set_all(100..103, &cars).commit(Report::Moved)?;
//! assert_eq!(answer.pairs(), [[0, 100], [25, 101], [25, 102], [101, 102]]);
//! drop(answer);
//!
//! // The block is unloaded. Its indices are free for another one.
//! drop(city.edit().remove_all(0..100).commit(Report::Nothing)?);
//! assert_eq!(city.len(), 3);
//! # Ok(())
//! # }
//! ```
//!
//! # Pools, and answers that nobody waits for
//!
//! ```
//! use pairmask::scene::{EndReason, SceneOptions, Report};
//! use pairmask::{Aabb, Session};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! let mut session = Session::builder().connect()?;
//! let mut scene = session.scene(SceneOptions::default());
//!
//! // Indices 0 to 7 are projectiles that nobody has fired, index 8 is a target.
//! let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 9];
//! let edit = scene.edit().set_all(0..9, &boxes).switch_all(0..8, false);
//! let answer = edit.commit(Report::Changes)?;
//! assert!(answer.begun().is_empty());
//! drop(answer);
//!
//! // One is fired, in a tick whose pairs nobody asks for.
//! drop(scene.edit().set(3, boxes[8]).switch(3, true).commit(Report::Nothing)?);
//!
//! // Nobody waits for the answer of the next tick. The one after makes up for it.
//! drop(scene.edit().submit(Report::Changes)?);
//! assert_eq!(scene.edit().commit(Report::Changes)?.begun(), [[3, 8]]);
//!
//! // Then the projectile goes back to the pool.
//! let answer = scene.edit().switch(3, false).commit(Report::Changes)?;
//! let ended = answer.ended().to_vec();
//! assert_eq!((ended[0].pair, ended[0].reason), ([3, 8], EndReason::Filtered));
//! # Ok(())
//! # }
//! ```
//!
//! # Who meets whom
//!
//! Worlds, owners, and filters by category and mask are part of the scene: the daemon leaves out the pairs of
//! boxes that may not meet. [`filters`](crate::filters) has the rule, and how those of other engines are
//! written in it. To change a tag, the table or a list of pairs is an edit like any other: pairs end as
//! [`Filtered`](crate::scene::EndReason::Filtered), or begin. Tag and listed pairs end with their box, as its flags do.
//!
//! ```
//! use pairmask::filters::{Filter, FilterId, FilterTable, Owner, Tag};
//! use pairmask::scene::{SceneOptions, Report};
//! use pairmask::{Aabb, Session};
//!
//! # fn main() -> Result<(), Box<dyn std::error::Error>> {
//! const BODY: FilterId = FilterId(0);
//! const SENSOR: FilterId = FilterId(1);
//! let mut session = Session::builder().connect()?;
//! let mut scene = session.scene(SceneOptions::default());
//!
//! // Bodies meet all; sensors meet bodies only.
//! let table = FilterTable::new(&[Filter::new(0b01, 0b11), Filter::new(0b10, 0b01)])?;
//! // Two parts of one robot, and two sensors, all in one place.
//! let robot = Tag::default().with_filter(BODY).with_owner(Owner(1));
//! let sensor = Tag::default().with_filter(SENSOR);
//! let boxes = [Aabb::new([0.0; 3], [1.0; 3]); 4];
//! let edit = scene.edit().set_all(0..4, &boxes).filters(&table);
//! let tags = [robot, robot, sensor, sensor];
//! let edit = edit.tag_all(0..4, &tags);
//! let answer = edit.commit(Report::Changes)?;
//! assert_eq!(answer.begun(), [[0, 2], [0, 3], [1, 2], [1, 3]]);
//! drop(answer);
//!
//! // The robot is taken apart.
//! let answer = scene.edit().tag(1, robot.with_owner(Owner(2))).commit(Report::Changes)?;
//! assert_eq!(answer.begun(), [[0, 1]]);
//! # Ok(())
//! # }
//! ```
//!
//! # Indices
//!
//! * Indices are yours. Count them from 0 and give free ones to new boxes: memory, and now and then time, go
//!   by the highest index, not by the number of boxes.
//! * An index may be removed and set in one edit. It is another box then, with fresh flags: its old pairs
//!   end as [`Removed`](crate::scene::EndReason::Removed), and its new ones begin.
//! * Ids with generations do not do as indices. Keep a table from index to id.
//! * Indices are below [`SceneOptions::most_boxes`]. An edit beyond is refused.
//!
//! # Static, off, removed
//!
//! * **Static**: two static boxes are no pair, and none is looked for. A static box may move: set it as any
//!   other. Pairs with boxes that are not static are told as ever. Make a prop that was hit
//!   not static, and static again when it lies.
//! * **Off**: a box overlaps nothing, and keeps its index, box and flags. It may be set meanwhile. Use it for
//!   what comes back: pools, hidden layers, ghosts, the dead who respawn. A pair ends as
//!   [`Filtered`](crate::scene::EndReason::Filtered).
//! * **Removed**: the index is free. Use it for what does not come back.
//! * A box that sleeps is none of these. It is not sent, and its pairs go on.
//! * Setting a box leaves its flags.
//!
//! # Memory
//!
//! * This process keeps 25 bytes for each index up to the highest ([`Scene::allocated_bytes`]).
//! * The daemon keeps 90 to 125 bytes a box where up to a tenth of the boxes move, 260 to 360 where a third or
//!   all do, and 300 to 540 right after all pairs were reported. That is what CPU engines kept of 10,000 to a
//!   million boxes, 2 and 10 pairs a box. [`Scene::daemon_bytes`] tells yours.
//! * Where this process answers, it keeps what the daemon would, and with [`Backend::Auto`] the 25 bytes too.
//! * [Margins](#margins-a-box) add 25 bytes for each index, with exact pairs 50, and 8 to 16 for each near pair.
//! * All scenes of a daemon together have a third of the machine's memory unless `pairmaskd serve --max-scene-mib`
//!   says otherwise. A scene for which that is too little on several GPUs is kept on fewer.
//!   A dropped [`Scene`] is freed in the daemon, and so are those of a client that dies.
//!
//! # Faults
//!
//! | what happens | [`Backend::Auto`] | [`Backend::Daemon`] |
//! |---|---|---|
//! | the daemon dies or restarts, before or during an edit | the edit is answered, by the new daemon or in process. The next changes are a resync | an error while there is none. Then the scene is sent again by itself, and the next changes are a resync |
//! | the daemon has no room for the scene | this process answers, and tries the daemon again after 2 s | [`CommitError::Wait`] with the daemon's status |
//! | the daemon is too old for scenes | this process answers | [`FrameError::DaemonTooOld`] |
//! | three frames or answers are held | [`FrameError::TooManyFrames`]: drop one | the same |
//! | the edit is wrong: an absent index, one set twice | [`CommitError::Edit`] | the same |
//!
//! After [`CommitError::Edit`] and [`CommitError::Frame`] the scene is what it was: send the edit again when
//! what was wrong is put right. After [`CommitError::Wait`] the edit is applied: go on with the next one, which
//! makes up for the lost answer.
//!
//! # Records
//!
//! Figures are from records in the repository's `tests/records`, which name machine, commit and command:
//!
//! * the way to a daemon, and 64 boxes in process: `README.md`, section `2026-11-21-epyc-2-cores`;
//! * several clients: `2026-11-22-h200/bundles.txt`;
//! * a frame's time by the share of boxes that move: `2026-11-21-h200/grid.md`, Figure 6;
//! * narrow forms: `README.md`, section `2026-11-21-h200`.

#[cfg(doc)]
use crate::scene::{MarginedPairs, Report, SceneOptions};
#[cfg(doc)]
use crate::{Aabb, Backend, CommitError, FrameError, Scene, SceneAnswer, SceneEdit, Session};
