use std::sync::atomic::AtomicBool;

use proptest::prelude::*;

use super::*;

fn directory(name: &str) -> (RuntimeDir, InstanceName) {
    let path = std::env::temp_dir().join(format!("pairmask-count-{}-{name}", std::process::id()));
    let dir = RuntimeDir::at(path);
    dir.ensure().unwrap();
    (dir, InstanceName::default())
}

fn answered(objects: u64, pairs: u64, of: AnsweredOf) -> Answered {
    let times = StageTimes { ingest_ns: 1, plan_ns: 2, execute_ns: 3, publish_ns: 4, total_ns: 11 };
    Answered { token: 7, objects, pairs, of, engine: EngineName::CpuGrid, threads: 2, times }
}

#[test]
fn what_a_worker_counts_is_read_from_its_file_as_long_as_clients_stay() {
    let (dir, name) = directory("counts");
    assert_eq!(dir.read_counters(&name).unwrap(), None, "no file");
    let counters = Counters::create(&dir, &name, 2).unwrap();
    let read = || dir.read_counters(&name).unwrap().unwrap();
    assert_eq!(read(), CounterSample { worker: std::process::id(), ..CounterSample::default() });

    let one = counters.client(5, std::process::id(), 1000);
    let two = counters.client(6, 0, 1000);
    one.note_received(240, 50);
    one.note_answered(&answered(10, 3, AnsweredOf::Frame));
    one.note_answered(&answered(2, 1, AnsweredOf::Edit { boxes: 100, pairs: Some(30) }));
    one.note_answered(&answered(1, 4, AnsweredOf::Query));
    one.note_sent(4096, 1 << 20);
    one.note_used(99);
    one.note_error();
    counters.note_answered(AnsweredTotals { frames: 3, pairs: 8, errors: 1, ..Default::default() });
    counters.note_queue(4, 1);
    counters.note_gpus(
        ["NVIDIA H200", "a name that is much longer than there is room for, by far"].into_iter(),
    );
    let sample = read();
    let [client, idle] = sample.clients[..] else { panic!("{sample:?}") };
    assert_eq!((client.session, client.process, client.user), (5, std::process::id().into(), 1000));
    assert_eq!(client.process_name(), process_name(std::process::id()));
    assert_eq!((client.frames, client.edits, client.queries, client.errors), (3, 1, 1, 1));
    assert_eq!((client.boxes, client.pairs, client.moved, client.kept), (13, 8, 2, 100));
    assert_eq!((client.last_boxes, client.last_pairs, client.threads), (100, 30, 2));
    assert_eq!((client.ingest_ns, client.total_ns, client.wait_ns), (3, 33, 50));
    assert_eq!((client.used_ns, client.received_bytes, client.sent_bytes), (99, 240, 4096));
    assert_eq!((idle.session, idle.frames, idle.process_name().as_str()), (6, 0, ""));
    let totals = &sample.totals;
    assert_eq!(
        (totals.frames, totals.pairs, totals.waiting, totals.received_bytes),
        (3, 8, 4, 240)
    );
    assert_eq!(sample.gpus[0], "NVIDIA H200");
    assert_eq!(sample.gpus[1].len(), 57);

    let scene = counters.scene(5, 9);
    scene.note_size(100, 4 << 10);
    scene.note_edit((2, 100), Some(30), EngineName::CpuGrid, &StageTimes::default());
    let [of_five] = read().scenes[..] else { panic!() };
    assert_eq!((of_five.session, of_five.scene, of_five.boxes, of_five.kept), (5, 9, 100, 100));
    two.end();
    assert_eq!(read().clients.len(), 1);
    drop((scene, one, two));
    let sample = read();
    assert_eq!((sample.clients.len(), sample.scenes.len(), sample.totals.frames), (0, 0, 3));
    fs::remove_dir_all(dir.path()).unwrap();
}

#[test]
fn records_are_used_again_from_zero_and_clients_beyond_them_are_not_counted() {
    let counters = Counters::unseen(1);
    let room = counters.layout.clients.count;
    for round in 0..3 {
        let clients: Vec<_> = (0..room as u64 + 3).map(|n| counters.client(1 + n, 0, 0)).collect();
        assert_eq!(clients.iter().filter(|client| client.at.is_some()).count(), room);
        for client in &clients {
            let frames = || client.record().0.get(word!(ClientCounts, frames));
            assert!(frames().is_none_or(|word| word.load(Ordering::Relaxed) == 0), "{round}");
            client.note_answered(&answered(1, 1, AnsweredOf::Frame));
        }
    }
    assert_eq!(lock(&counters.free_clients).len(), room);
}

#[test]
fn a_client_is_never_read_as_another() {
    let (dir, name) = directory("claims");
    let counters = Counters::create(&dir, &name, 1).unwrap();
    let stop = AtomicBool::new(false);
    std::thread::scope(|scope| {
        scope.spawn(|| {
            for session in 1..50_000 {
                let client = counters.client(session, 0, session as u32);
                client.note_received(session, session);
            }
            stop.store(true, Ordering::Relaxed);
        });
        while !stop.load(Ordering::Relaxed) {
            let sample = dir.read_counters(&name).unwrap().unwrap();
            for client in sample.clients {
                assert_eq!(client.user, client.session);
                assert!([0, client.session].contains(&client.wait_ns), "{client:?}");
            }
        }
    });
    fs::remove_dir_all(dir.path()).unwrap();
}

/// A file that is cut while the worker counts costs the worker its counters, and nothing else.
#[test]
fn a_file_that_is_cut_does_not_end_the_worker() {
    let (dir, name) = directory("cut");
    crate::guard::install().unwrap();
    let counters = Counters::create(&dir, &name, 100).unwrap();
    let client = counters.client(1, 0, 0);
    OpenOptions::new().write(true).open(dir.counters_file(&name)).unwrap().set_len(0).unwrap();
    client.note_answered(&answered(1, 1, AnsweredOf::Frame));
    client.note_sent(1, 1);
    assert_eq!(dir.read_counters(&name).unwrap(), None);
    fs::remove_dir_all(dir.path()).unwrap();
}

/// A file of a worker with a client and a scene.
fn file() -> Vec<u8> {
    let counters = Counters::unseen(2);
    let client = counters.client(3, 0, 0);
    client.note_answered(&answered(5, 6, AnsweredOf::Frame));
    let scene = counters.scene(3, 1);
    let (head, _) = head_of(2);
    let mut bytes = bytemuck::bytes_of(&head).to_vec();
    let words = counters.memory.words()[bytes.len() / 8..].iter();
    words.for_each(|word| bytes.extend(word.load(Ordering::Relaxed).to_le_bytes()));
    drop((scene, client));
    bytes
}

#[test]
fn a_file_of_another_version_is_none_and_a_record_that_changed_hands_is_left_out() {
    let bytes = file();
    let sample = CounterSample::parse(&bytes, &bytes).unwrap();
    assert_eq!((sample.clients[0].frames, sample.scenes[0].session), (1, 3));
    let (_, layout) = head_of(2);
    let mut other = bytes.clone();
    other[8 * layout.clients.record(layout.clients.count - 1).start] = 0;
    let at = bytes.windows(8).position(|eight| eight == 3_u64.to_le_bytes()).unwrap();
    other[at] = 4;
    assert_eq!(CounterSample::parse(&bytes, &other).unwrap().clients, []);
    let mut other = bytes.clone();
    other[8] += 1;
    assert_eq!(CounterSample::parse(&bytes, &other), None, "the head has changed");
    assert_eq!(CounterSample::parse(&other, &other), None, "another version");
}

proptest! {
    #[test]
    fn any_bytes_are_read_without_harm(
        cut in 0..20_000_usize,
        changes in proptest::collection::vec((0..200_usize, any::<u8>()), 0..20),
    ) {
        let mut bytes = file();
        bytes.truncate(cut.max(1));
        for (at, to) in changes {
            let at = at % bytes.len();
            bytes[at] = to;
        }
        let _ = CounterSample::parse(&bytes, &bytes);
    }
}
