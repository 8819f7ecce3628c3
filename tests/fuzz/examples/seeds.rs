//! Writes the seeds of the corpus: valid messages, by the crates' own writers. What fuzzing has found lies beside them.
//!
//! `cargo run -p pairmask-fuzz --example seeds`

use std::ops::Range;
use std::path::Path;
use std::time::Duration;
use std::{fs, io};

use pairmask_core::cast::{Hit, Hits, Ray, Shapes};
use pairmask_core::dispatch::{CpuEngines, CullOptions, StageTimes};
use pairmask_core::engine::{EngineChoice, HeapReply};
use pairmask_core::filters::{Filter, FilterData, FilterTable, Rules, World};
use pairmask_core::objects::ObjectForm;
use pairmask_core::scene::shared::{AtEnd, Scope};
use pairmask_core::scene::{
    Edit, FilterDataSets, Indices, QueryFilterData, QueryMask, Report, Scene, SceneOptions, Sets,
    Step, UserData, UserDataSets,
};
use pairmask_core::units::BoxCount;
use pairmask_core::{Aabb, BoxForm, Encoding, EncodingChoice, EngineName, Sphere};
use pairmask_transport::{DaemonRecord, GpuCounts, StatusFile};
use pairmask_wire::{
    AgreedTerms, CastRequest, CullRequest, EditLayout, JoinRequest, LeaseAction, LeaseRequest,
    Page, QueryRequest, ReplyFields, RequestHeader, ResponseHeader, RulesLayout, SceneAnswerLayout,
    SceneId, SceneName, SceneRequest, SceneSections, SharedTerms, SkipTotals, StatusBody,
    StatusCode, TickMarks, TickNotes, Version, page_count, response_cast, response_error,
    response_joined, response_leased, response_ok, response_scene, response_status, write_scene,
    write_world_ranges,
};
use pairmaskd::cli::object_files::{FileObject, Format, write_objects};
use pairmaskd::recording::{Answered, Event, Record, RecordFile, RecordSettings, SessionEnd};

/// Where a status file says when it was written.
const WRITTEN_AT: Range<usize> = 8..16;

/// A target, the name of a seed, and the seed.
type Seed = (&'static str, String, Vec<u8>);

fn main() -> io::Result<()> {
    let corpus = Path::new(env!("CARGO_MANIFEST_DIR")).join("corpus");
    let seeds =
        [requests(), replies(), scene_files(), files(), recordings()?, short_numbers()].concat();
    for (target, name, bytes) in &seeds {
        fs::create_dir_all(corpus.join(target))?;
        fs::write(corpus.join(target).join(format!("seed-{name}")), bytes)?;
    }
    println!("{} seeds", seeds.len());
    Ok(())
}

fn boxes(count: usize) -> Vec<Aabb> {
    let corner = |at: usize| [at as f32 * 0.75, (at % 3) as f32, 0.0];
    (0..count).map(|at| Aabb::new(corner(at), corner(at).map(|x| x + 1.0))).collect()
}

fn pages(bytes: u64) -> Vec<Page> {
    vec![bytemuck::Zeroable::zeroed(); page_count(bytes) as usize]
}

/// A message: its header, and of its payload what it uses.
fn message(header: &[u8], pages: &[Page], used: u64) -> Vec<u8> {
    [header, &bytemuck::cast_slice(pages)[..used as usize]].concat()
}

fn some_rules(n: usize) -> Rules {
    let mut rules = Rules::default();
    rules.filter_data =
        (0..n).map(|at| FilterData::default().with_world(World(at as i32 % 2))).collect();
    rules.table = FilterTable::new(&[Filter::new(1, 2), Filter::new(2, 1)]).expect("two");
    rules.lists.include([0, 1], true);
    rules.lists.exclude([0, 2], true);
    rules
}

fn requests() -> Vec<Seed> {
    let mut seeds = Vec::new();
    let mut add = |name: String, header: RequestHeader, pages: &[Page], used: u64| {
        seeds.push(("requests", name, message(bytemuck::bytes_of(&header), pages, used)));
    };
    let n = BoxCount::new(7);
    for form in ObjectForm::ALL {
        let request = CullRequest::of(SceneSections::first(form, n));
        let bytes = form.bytes(n);
        add(format!("cull-{form}"), RequestHeader::cull(1, 2, &request), &pages(bytes), bytes);
    }
    let scene = SceneSections::first(ObjectForm::ALL[0], n);
    let sets = CullRequest { first_set: Some(BoxCount::new(3)), ..CullRequest::of(scene) };
    add("between".into(), RequestHeader::cull(1, 2, &sets), &pages(168), 168);
    let rules = some_rules(n.len());
    let layout = RulesLayout::of(&rules, n, scene.payload_bytes()).expect("few");
    let ruled = CullRequest {
        rules: Some(layout.sections()),
        rules_number: 5,
        engine: EngineChoice::Only(EngineName::CpuGrid),
        encoding: EncodingChoice::Only(Encoding::List),
        threads: Some(1),
        ..CullRequest::of(scene)
    };
    let mut payload = pages(layout.payload_bytes());
    assert!(layout.write(&rules, &mut payload));
    add("rules".into(), RequestHeader::cull(1, 2, &ruled), &payload, layout.payload_bytes());
    let known = CullRequest { rules: None, ..ruled };
    add("known-rules".into(), RequestHeader::cull(1, 2, &known), &pages(168), 168);
    add("status".into(), RequestHeader::status(1, 2), &[], 0);
    add("end".into(), RequestHeader::end_scene(1, 2, SceneId(3)), &[], 0);
    add("leave".into(), RequestHeader::leave_shared(1, 2, SceneId(3)), &[], 0);

    let (request, payload, used) = edit_request();
    add("edit".into(), RequestHeader::edit_scene(1, 2, &request), &payload, used);
    add("commit".into(), RequestHeader::commit_shared(1, 2, &request), &payload, used);

    let each = vec![FilterData::default().with_world(World(4)); 5];
    for (at, filter_data) in
        [QueryFilterData::None, QueryFilterData::One(each[0]), QueryFilterData::Each(&each)]
            .into_iter()
            .enumerate()
    {
        let mask = QueryMask::new(5, 9).expect("few");
        let request = QueryRequest::new(SceneId(3), Some(7), mask, Encoding::ALL[at], &filter_data);
        let mut payload = pages(request.payload_bytes());
        assert!(request.write(&boxes(5), &filter_data, &mut payload));
        let header = RequestHeader::query_scene(1, 2, &request);
        add(format!("query-{at}"), header, &payload, request.payload_bytes());

        let rays = [Ray::between([-1.0; 3], [5.0, 1.0, 1.0]); 5];
        let spheres = [Sphere::new([1.0; 3], 2.0); 5];
        for (name, shapes) in
            [("rays", Shapes::Rays(&rays)), ("spheres", Shapes::Spheres(&spheres))]
        {
            let hits = [Hits::All, Hits::Closest(2), Hits::Any][at];
            let request = CastRequest::new(SceneId(3), None, shapes, hits, &filter_data);
            let request = request.expect("few");
            let mut payload = pages(request.payload_bytes());
            assert!(request.write(shapes, &filter_data, &mut payload));
            let header = RequestHeader::cast_scene(1, 2, &request);
            add(format!("cast-{name}-{at}"), header, &payload, request.payload_bytes());
        }
    }
    let name: SceneName = "level/1".parse().expect("a name");
    let mut payload = pages(64);
    assert!(name.write(&mut payload));
    let join = JoinRequest {
        scene: SceneId(3),
        name: name.section(),
        terms: SharedTerms {
            most_boxes: Some(9),
            deadline: Some(Duration::from_millis(5)),
            at_end: Some(AtEnd::Keep),
        },
        scope: Scope::All,
        engine: EngineChoice::Auto,
    };
    add("join".into(), RequestHeader::join_shared(1, 2, &join), &payload, 64);
    for (at, action) in [
        LeaseAction::Take { first: 3, count: 9 },
        LeaseAction::TakeAny { count: 9 },
        LeaseAction::GiveBack { first: 3 },
    ]
    .into_iter()
    .enumerate()
    {
        let lease = LeaseRequest { scene: SceneId(3), action };
        add(format!("lease-{at}"), RequestHeader::lease_shared(1, 2, &lease), &[], 0);
    }
    seeds
}

/// An edit with every step.
fn with_steps<T>(f: impl FnOnce(Edit<'_>) -> T) -> T {
    let (boxes, table) = (boxes(9), FilterTable::new(&[Filter::new(1, 2)]).expect("one"));
    let filter_data = [FilterData::default().with_world(World(3)); 2];
    let user_data = [UserData::from(77), UserData::from(u64::MAX)];
    let steps = [
        Step::Set(Sets { indices: (0..9).into(), boxes: &boxes }),
        Step::Enable(Indices::List(&[4, 2]), false),
        Step::Enable(Indices::Mask { first: 2, words: &[5] }, true),
        Step::Static((5..8).into(), true),
        Step::Static((5..6).into(), false),
        Step::FilterData(FilterDataSets { indices: (&[7, 8]).into(), filter_data: &filter_data }),
        Step::UserData(UserDataSets { indices: (&[7, 1]).into(), user_data: &user_data }),
        Step::Filters(&table),
        Step::Include(&[[1, 2]], true),
        Step::Include(&[[1, 2]], false),
        Step::Exclude(&[[0, 1], [3, 4]], true),
        Step::Exclude(&[[0, 1]], false),
    ];
    f(Edit { steps: &steps })
}

fn edit_request() -> (SceneRequest, Vec<Page>, u64) {
    with_steps(|edit| {
        let layout = EditLayout::of(edit).expect("small");
        let mut payload = pages(layout.payload_bytes());
        assert!(layout.write(edit, &mut payload));
        let [boxes, steps, indices] = layout.sections();
        let request = SceneRequest {
            scene: SceneId(3),
            base: 1,
            revision: 2,
            is_acknowledged: true,
            is_lost: false,
            reported: None,
            report: Report::Changes,
            most_boxes: 20,
            engine: EngineChoice::Auto,
            threads: None,
            boxes,
            steps,
            indices,
        };
        (request, payload, layout.payload_bytes())
    })
}

fn replies() -> Vec<Seed> {
    let mut seeds = Vec::new();
    let mut add = |name: String, header: ResponseHeader, words: &[u32]| {
        let bytes = [bytemuck::bytes_of(&header), bytemuck::cast_slice(words)].concat();
        seeds.push(("replies", name, bytes));
    };
    let n = BoxCount::new(40);
    let fields = ReplyFields { client_token: 1, frame: 2, box_count: n };
    for encoding in Encoding::ALL {
        for engine in [EngineName::CpuBrute, EngineName::CpuGrid] {
            let options = CullOptions {
                engine: EngineChoice::Only(engine),
                encoding: EncodingChoice::Only(encoding),
                ..CullOptions::default()
            };
            let mut reply = HeapReply::new();
            let mut engines = CpuEngines::new();
            let answer = engines.cull_filtered(&boxes(40), &some_rules(40), &options, &mut reply);
            let answer = answer.expect("a small frame");
            let (cull, worlds) = (answer.answer, answer.worlds);
            let mut header = response_ok(&fields, engine, 1, &cull.report, &StageTimes::default());
            let mut words = reply.words()[..cull.report.shape.extent_words() as usize].to_vec();
            if !worlds.is_empty() {
                let start = words.len();
                words.resize(start + 3 * worlds.len(), 0);
                write_world_ranges(worlds, &mut words[start..]);
                let len = (words.len() - start) as u64;
                header.put_world_ranges(pairmask_core::mask::Span { start: start as u64, len });
            }
            add(format!("{encoding}-{engine}"), header, &words);
        }
    }
    let mut scene = Scene::new(SceneOptions::default());
    let reported = |scene: &mut Scene, report| {
        with_steps(|edit| scene.edit(edit, report).expect("a right edit").clone())
    };
    let times = StageTimes::default();
    let mut ranged = reported(&mut scene, Report::All);
    scene.acknowledge();
    for (name, steps) in [("removed", &[Step::Remove((2..5).into())][..]), ("all", &[])] {
        let layout = SceneAnswerLayout::of(&ranged);
        let notes = TickNotes { tick: 3, late: &[4..9, 12..13], user_data: &[(7, 77)] };
        let marks = TickMarks::after(&layout, &notes);
        let mut words = vec![0; marks.words() as usize];
        layout.write(&ranged, &mut words);
        marks.write(&notes, &mut words);
        let header = response_scene(&fields, EngineName::CpuGrid, 1, &ranged, 99, &times);
        add(format!("scene-{name}"), header, &words);
        add(format!("tick-{name}"), marks.mark(header), &words);
        ranged = scene.edit(Edit { steps }, Report::Changes).expect("a right edit").clone();
    }
    let hits = [[0, 3], [0, 1], [2, 999]];
    let hits = hits.map(|[query, index]| Hit { query, index, distance: 1.0 });
    let header = response_cast(&fields, EngineName::CpuTree, 1, hits.len(), &times);
    add("cast".into(), header, bytemuck::cast_slice(&hits));
    let body = StatusBody { frames: 7, ..StatusBody::default() };
    add("status".into(), response_status(&fields), bytemuck::cast_slice(&[body]));
    let terms =
        AgreedTerms { most_boxes: 9, deadline: Duration::from_millis(5), at_end: AtEnd::Remove };
    add("joined".into(), response_joined(&fields, &terms), &[]);
    add("leased".into(), response_leased(&fields, &(3..12)), &[]);
    for status in 1..40 {
        if let Some(status) = StatusCode::from_wire(status) {
            let name = format!("status-{}", status as u32);
            add(name, response_error(&fields, status, [2, 1 << 33]), &[]);
        }
    }
    seeds
}

/// Recordings: whole ones, and records as the target puts them into a block.
fn recordings() -> io::Result<Vec<Seed>> {
    let n = BoxCount::new(7);
    let header = RequestHeader::cull(1, 2, &CullRequest::of(SceneSections::first(BoxForm::F32, n)));
    let request = |number, moved: f32| {
        let boxes: Vec<Aabb> =
            boxes(7).iter().map(|b| Aabb::new(b.min, b.max.map(|x| x + moved))).collect();
        let payload = bytemuck::cast_slice(&boxes).to_vec();
        Event::Request { session: 3, number, header: Box::new(header), payload }
    };
    let answered =
        Answered { engine: 1, total_ns: 5_000, count: 6, digest: 77, ..Answered::default() };
    let events = [
        request(1, 0.0),
        Event::Answer { number: 1, answered },
        request(2, 0.1),
        Event::SessionEnded { session: 3, why: SessionEnd::TooFast },
        Event::WorkerBegan,
    ];
    let mut seeds = Vec::new();
    for (name, blocks) in [("one-block", 1), ("blocks", events.len())] {
        let file = tempfile::NamedTempFile::new()?;
        let settings = RecordSettings { file: file.path().to_owned(), most_bytes: u64::MAX };
        let mut writer = RecordFile::create(&settings).map_err(io::Error::other)?;
        for (at, event) in events.iter().enumerate() {
            writer.write(&Record { at_ns: 1_000 * at as u64, event: event.clone() })?;
            if at + blocks >= events.len() {
                writer.flush()?;
            }
        }
        seeds.push(("recordings", name.to_owned(), [&[0], &fs::read(file.path())?[..]].concat()));
    }
    // Bytes, check, kind, flags, time, session, number, and what follows.
    let raw = |kind: u32, flags: u32, body: &[u8]| {
        let words = [body.len() as u32, 0, kind, flags, 9, 0, 3, 0, 1, 0];
        [bytemuck::cast_slice::<u32, u8>(&words), body].concat()
    };
    let planes = [bytemuck::bytes_of(&header), &[0; 168]].concat();
    let records = [
        raw(1, 0, &planes),
        raw(1, 1, &planes),
        raw(2, 0, &[0; 32]),
        raw(3, 2, &[]),
        raw(4, 0, &[]),
    ];
    seeds.push(("recordings", "records".to_owned(), [&[1], &records.concat()[..]].concat()));
    Ok(seeds)
}

fn scene_files() -> Vec<Seed> {
    let mut whole = Vec::new();
    with_steps(|edit| write_scene(edit, &mut whole)).expect("memory");
    let mut empty = Vec::new();
    write_scene(Edit::NONE, &mut empty).expect("memory");
    let mut saved = Vec::new();
    let mut scene = Scene::new(SceneOptions::default());
    with_steps(|edit| scene.edit(edit, Report::Nothing).map(drop)).expect("a right edit");
    write_scene(Edit { steps: &scene.whole().steps() }, &mut saved).expect("memory");
    let of = |name: &str, bytes: Vec<u8>| {
        ("files", format!("scene-{name}"), [&[7], &bytes[..]].concat())
    };
    vec![of("steps", whole), of("empty", empty), of("saved", saved)]
}

fn files() -> Vec<Seed> {
    let record =
        DaemonRecord { worker_pid: 7, supervisor_pid: 6, version: Version::CURRENT, fences: 0 };
    let status =
        StatusFile::now(StatusBody::default(), SkipTotals::default(), GpuCounts::default());
    let mut status = bytemuck::bytes_of(&status).to_vec();
    // A seed is the same each time.
    status[WRITTEN_AT].fill(0);
    let config = "instance = 'world'\nbackend = 'in-process'\nencoding = 'sparse'\nthreads = 2\n\
                  spin-us = 0\ngpu = 'none'\nisa = 'portable'\naudit = '1/100'\n";
    let of =
        |kind: u8, name: &str, bytes: &[u8]| ("files", name.to_owned(), [&[kind], bytes].concat());
    let mut seeds = vec![
        of(0, "record", record.to_string().as_bytes()),
        of(1, "status-file", &status),
        of(2, "name", b"level/1"),
        of(3, "config", config.as_bytes()),
        of(3, "wrong-config", b"threads = '2'\nengin = 3\n"),
        of(5, "boxes", bytemuck::cast_slice(&boxes(2))),
        of(6, "spheres", bytemuck::bytes_of(&Sphere::new([1.0; 3], 2.0))),
        of(8, "text", b"# boxes\n0 0 0 1 1 1\n-1e9 0.5 -inf nan 2 3\n"),
        of(9, "csv", b"min.x,min.y,min.z,max.x,max.y,max.z\n0,0,0,1,1,1\n"),
        of(9, "wrong-csv", b"0,0,0,1,1,1\n0,0,o,1,1,1\n"),
        of(10, "array", &array(&boxes(2))),
        of(10, "array-of-f64", &doubled(&array(&boxes(1)))),
        of(11, "array-of-spheres", &array(&[Sphere::new([1.0; 3], 2.0)])),
    ];
    for option in ["auto", "cpu-grid", "list", "1/100", "off", "0,2", "q16", "avx2", "daemon", "18"]
    {
        seeds.push(of(
            4,
            &format!("option-{}", option.replace([',', '/'], "-")),
            option.as_bytes(),
        ));
    }
    seeds
}

/// A file of numpy.
fn array<T: FileObject>(objects: &[T]) -> Vec<u8> {
    let mut file = Vec::new();
    write_objects(&mut file, Format::Npy, objects).expect("memory");
    file
}

/// An array of one box as f64: its header says so, and there are twice as many bytes.
fn doubled(array: &[u8]) -> Vec<u8> {
    let (header, numbers) = array.split_at(array.len() - size_of::<Aabb>());
    let header = String::from_utf8_lossy(&header[8..]).replace("<f4", "<f8");
    [&array[..8], header.as_bytes(), &[0; size_of::<Aabb>()], numbers].concat()
}

/// Inputs of short numbers, whose meaning is their targets'.
fn short_numbers() -> Vec<Seed> {
    let mut seeds = Vec::new();
    for (kind, target) in ["culls", "edits", "masks", "questions"].into_iter().enumerate() {
        for (len, factor) in [(40, 7), (200, 13), (700, 29), (1_500, 5)] {
            let byte = |at: usize| (at * factor + at / 7 * kind) as u8 % 64;
            seeds.push((target, format!("{len}"), (0..len).map(byte).collect()));
        }
    }
    seeds
}
