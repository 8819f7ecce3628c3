//! Links over Zenoh: who finds whom, with and without certificates.

use std::net::TcpListener;
use std::path::{Path, PathBuf};
use std::process::Command;
use std::time::{Duration, Instant};

use pairmask_bridge::ids::MachineId;
use pairmask_bridge::node::Destination;
use pairmask_bridge::zenoh_link::{LinkError, Meeting, ZenohLink};

/// A hang ends so.
const TIMEOUT: Duration = Duration::from_mins(1);

/// A port that nobody has a moment ago.
fn free_endpoint(scheme: &str) -> String {
    let listener = TcpListener::bind("127.0.0.1:0").expect("a port");
    format!("{scheme}/{}", listener.local_addr().expect("its address"))
}

fn open(meeting: &Meeting, machine: u32) -> ZenohLink {
    ZenohLink::open(meeting, "town", MachineId(machine)).expect("a link")
}

fn received(link: &ZenohLink) -> impl Iterator<Item = Vec<u8>> {
    std::iter::from_fn(|| link.receive())
}

/// Sends until each has received the other's. Returns all that they received.
fn meet(one: &ZenohLink, other: &ZenohLink) -> Vec<Vec<u8>> {
    let (start, mut all) = (Instant::now(), Vec::new());
    let has = |all: &[Vec<u8>], what: &[u8]| all.iter().any(|bytes| bytes == what);
    while !has(&all, b"from 0") || !has(&all, b"from 1") {
        assert!(start.elapsed() < TIMEOUT, "all: {all:?}");
        one.send(Destination::One(MachineId(1)), b"from 0".to_vec()).expect("sent or lost");
        other.send(Destination::All, b"from 1".to_vec()).expect("sent or lost");
        std::thread::sleep(Duration::from_millis(50));
        all.extend(received(one).filter(|bytes| bytes != b"from 0"));
        all.extend(received(other).filter(|bytes| bytes != b"from 1"));
    }
    all
}

#[test]
fn the_same_words_join_all_bridges() {
    let meeting = Meeting { join: free_endpoint("tcp"), config: None };
    let links: Vec<ZenohLink> = (0..3).map(|machine| open(&meeting, machine)).collect();
    meet(&links[0], &links[1]);
    // Bridges that only connect find each other too.
    let second = &links[2];
    let start = Instant::now();
    while !received(second).any(|bytes| bytes == b"to 2") {
        assert!(start.elapsed() < TIMEOUT, "the third one receives nothing");
        links[1].send(Destination::One(MachineId(2)), b"to 2".to_vec()).expect("sent or lost");
        std::thread::sleep(Duration::from_millis(50));
    }
    for (machine, link) in links.iter().enumerate() {
        link.set_status(format!("status of {machine}"));
    }
    let statuses = meeting.statuses("town").expect("they answer");
    assert_eq!(statuses, ["status of 0", "status of 1", "status of 2"]);
    assert!(meeting.statuses("village").expect("nobody answers").is_empty());
}

#[test]
fn what_is_no_endpoint_and_no_key_is_refused() {
    let meeting = Meeting { join: "10.0.0.1".into(), config: None };
    let refused = ZenohLink::open(&meeting, "town", MachineId(0)).map(drop);
    assert!(matches!(refused, Err(LinkError::Endpoint(_))), "{refused:?}");
    let meeting = Meeting { join: free_endpoint("tcp"), config: None };
    let refused = ZenohLink::open(&meeting, "a//b", MachineId(0)).map(drop);
    assert!(matches!(refused, Err(LinkError::Scene(_))), "{refused:?}");
}

/// A folder that is removed at the end.
struct Folder(PathBuf);

impl Drop for Folder {
    fn drop(&mut self) {
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// The configuration of the example for a name, with certificates of its own.
fn secured(folder: &Path, name: &str) -> PathBuf {
    let example = Path::new(env!("CARGO_MANIFEST_DIR")).join("examples/secured");
    let made = Command::new(example.join("make-certificates"))
        .arg(folder)
        .args([name, "127.0.0.1"])
        .status();
    assert!(made.expect("bash and openssl").success());
    let config = std::fs::read_to_string(example.join("zenoh.json5")).expect("the example");
    let own = folder.join(name);
    let config = config.replace("/etc/pairmask-bridge", own.to_str().expect("a name in UTF-8"));
    let path = own.join("zenoh.json5");
    std::fs::write(&path, config).expect("written");
    path
}

#[test]
fn certificates_decide_who_hears_whom() {
    let folder = std::env::temp_dir().join(format!("pairmask-bridge-{}", std::process::id()));
    let folder = Folder(folder);
    let join = free_endpoint("tls");
    let meeting = |name| Meeting { join: join.clone(), config: Some(secured(&folder.0, name)) };
    let (one, other) = (open(&meeting("bridge-0"), 0), open(&meeting("bridge-1"), 1));
    meet(&one, &other);
    // Of the same authority, but of no name in the configuration; and with no certificate at all.
    let stranger = open(&meeting("stranger"), 2);
    let connect = Meeting { join: join.replacen("tls", "tcp", 1), config: None };
    let plain = open(&connect, 3);
    let mut all = Vec::new();
    for _ in 0..20 {
        for link in [&stranger, &plain] {
            link.send(Destination::All, b"from a stranger".to_vec()).expect("sent or lost");
            link.send(Destination::One(MachineId(0)), b"from a stranger".to_vec())
                .expect("or lost");
        }
        one.send(Destination::One(MachineId(2)), b"for nobody".to_vec()).expect("sent or lost");
        all.extend(meet(&one, &other));
    }
    assert!(!all.iter().any(|bytes| bytes == b"from a stranger"));
    // A link receives its own messages, as far as it may.
    assert!(received(&stranger).all(|bytes| bytes == b"from a stranger"));
    assert!(received(&plain).all(|bytes| bytes == b"from a stranger"));
}
