//! Messages of bridges over Zenoh, from peer to peer or by a router.
//!
//! ```text
//! pairmask/SCENE/beat           to all bridges
//! pairmask/SCENE/to/MACHINE     to one
//! pairmask/SCENE/status/MACHINE where it stands, for who asks
//! ```
//!
//! A bridge listens where `--join` says so if that is an address of its machine that nobody has, and connects else. So the
//! same words start the first bridge and all others. Zenoh's gossip lets them find each other then.

use std::collections::BTreeMap;
use std::net::{TcpListener, ToSocketAddrs};
use std::path::PathBuf;
use std::sync::atomic::{AtomicU64, Ordering};
use std::sync::mpsc::{Receiver, SyncSender, sync_channel};
use std::sync::{Arc, Mutex, PoisonError};
use std::time::{Duration, Instant};

use zenoh::Wait;
use zenoh::key_expr::KeyExpr;
use zenoh::qos::{CongestionControl, Priority};
use zenoh::query::QueryTarget;

use crate::ids::MachineId;
use crate::node::Destination;

/// Messages that wait to be read. More are dropped, and sent again by who has sent them.
const MOST_WAITING: usize = 65_536;
/// `status` receives the answers of bridges one by one: it asks again so long after the first answer of another one.
const STATUS_WAIT: Duration = Duration::from_millis(1_500);
/// One question, and the pause before the next.
const STATUS_TIMEOUT: Duration = Duration::from_millis(500);
const STATUS_PAUSE: Duration = Duration::from_millis(100);

/// Why there is no link.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum LinkError {
    /// What Zenoh says.
    #[error("zenoh: {0}")]
    Zenoh(zenoh::Error),
    /// A name that Zenoh has no key for.
    #[error("scene '{0}': its name is no key of Zenoh: no '//', and no '/' at an end")]
    Scene(String),
    /// Not an endpoint.
    #[error("'{0}' is no endpoint: name one as tcp/HOST:PORT or tls/HOST:PORT")]
    Endpoint(String),
}

impl From<zenoh::Error> for LinkError {
    fn from(error: zenoh::Error) -> Self {
        Self::Zenoh(error)
    }
}

/// Where to meet the others.
#[derive(Clone, Debug, Default)]
pub struct Meeting {
    /// An endpoint that all bridges name.
    pub join: String,
    /// A configuration of Zenoh, for TLS, access control and all else.
    pub config: Option<PathBuf>,
}

impl Meeting {
    /// Opens a session of Zenoh.
    ///
    /// # Errors
    /// [`LinkError`].
    fn open(&self, may_listen: bool) -> Result<zenoh::Session, LinkError> {
        let mut config = match &self.config {
            Some(path) => zenoh::Config::from_file(path)?,
            None => zenoh::Config::default(),
        };
        let endpoint = serde_json::Value::from(self.join.as_str()).to_string();
        // Multicast finds every bridge of the network: a scene is for those that are configured for it.
        config.insert_json5("scouting/multicast/enabled", "false")?;
        if may_listen && self.is_ours()? {
            log::info!("listening at {}", self.join);
            config.insert_json5("listen/endpoints", &format!("[{endpoint}]"))?;
        } else {
            config.insert_json5("connect/endpoints", &format!("[{endpoint}]"))?;
            // Others connect to a port that the system chooses, by what gossip says.
            let scheme = self.join.split('/').next().unwrap_or("tcp");
            let any = serde_json::Value::from(format!("{scheme}/0.0.0.0:0")).to_string();
            let listens = if may_listen { format!("[{any}]") } else { "[]".to_owned() };
            config.insert_json5("listen/endpoints", &listens)?;
        }
        Ok(zenoh::open(config).wait()?)
    }

    /// Whether the endpoint is of this machine, and free.
    fn is_ours(&self) -> Result<bool, LinkError> {
        let wrong = || LinkError::Endpoint(self.join.clone());
        let (_, address) = self.join.split_once('/').ok_or_else(wrong)?;
        let address = address.split(['?', '#']).next().unwrap_or(address);
        let mut found = address.to_socket_addrs().map_err(|_| wrong())?;
        Ok(found.any(|address| TcpListener::bind(address).is_ok()))
    }

    /// Asks all bridges of a scene where they stand: a text of JSON from each.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn statuses(&self, scene: &str) -> Result<Vec<String>, LinkError> {
        let session = self.open(false)?;
        let key = key(scene, "status/*")?;
        let (mut found, mut new_at) = (BTreeMap::new(), Instant::now());
        while new_at.elapsed() < STATUS_WAIT {
            let all = session.get(&key).target(QueryTarget::All).timeout(STATUS_TIMEOUT);
            let replies = all.wait()?;
            while let Ok(reply) = replies.recv() {
                if let Ok(sample) = reply.result()
                    && let Ok(text) = sample.payload().try_to_string()
                    && found.insert(sample.key_expr().to_string(), text.into_owned()).is_none()
                {
                    new_at = Instant::now();
                }
            }
            std::thread::sleep(STATUS_PAUSE);
        }
        Ok(found.into_values().collect())
    }
}

fn key(scene: &str, rest: &str) -> Result<KeyExpr<'static>, LinkError> {
    let key = KeyExpr::try_from(format!("pairmask/{scene}/{rest}"));
    key.map_err(|_| LinkError::Scene(scene.to_owned()))
}

/// The link of one bridge.
pub struct ZenohLink {
    session: zenoh::Session,
    scene: String,
    beat: KeyExpr<'static>,
    received: Receiver<Vec<u8>>,
    dropped: Arc<AtomicU64>,
    status: Arc<Mutex<String>>,
}

impl ZenohLink {
    /// Joins the bridges of a scene.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn open(meeting: &Meeting, scene: &str, machine: MachineId) -> Result<Self, LinkError> {
        let (beat, own) = (key(scene, "beat")?, key(scene, &format!("to/{}", machine.0))?);
        let asked = key(scene, &format!("status/{}", machine.0))?;
        let session = meeting.open(true)?;
        let (sender, received) = sync_channel(MOST_WAITING);
        let dropped = Arc::new(AtomicU64::new(0));
        for of in [&beat, &own] {
            let (sender, dropped): (SyncSender<Vec<u8>>, _) =
                (sender.clone(), Arc::clone(&dropped));
            let take = move |sample: zenoh::sample::Sample| {
                if sender.try_send(sample.payload().to_bytes().into_owned()).is_err() {
                    dropped.fetch_add(1, Ordering::Relaxed);
                }
            };
            session.declare_subscriber(of).callback(take).background().wait()?;
        }
        let status = Arc::new(Mutex::new(String::new()));
        let (text, at) = (Arc::clone(&status), asked.clone());
        let answer = move |query: zenoh::query::Query| {
            let text = text.lock().unwrap_or_else(PoisonError::into_inner).clone();
            // It has not said where it stands yet: who asks asks again.
            if text.is_empty() {
                return;
            }
            if let Err(error) = query.reply(at.clone(), text).wait() {
                log::debug!("a status was asked for, and not received: {error}");
            }
        };
        session.declare_queryable(asked).callback(answer).background().wait()?;
        Ok(Self { session, scene: scene.to_owned(), beat, received, dropped, status })
    }

    /// Sends a message, or loses it: whatever matters is sent again.
    ///
    /// # Errors
    /// [`LinkError`].
    pub fn send(&self, to: Destination, bytes: Vec<u8>) -> Result<(), LinkError> {
        let key = match to {
            Destination::All => self.beat.clone(),
            Destination::One(machine) => key(&self.scene, &format!("to/{}", machine.0))?,
        };
        let put = self.session.put(key, bytes).congestion_control(CongestionControl::Drop);
        Ok(put.priority(Priority::RealTime).express(true).wait()?)
    }

    /// The next message that came.
    pub fn receive(&self) -> Option<Vec<u8>> {
        self.received.try_recv().ok()
    }

    /// Messages that came and found no room.
    pub fn dropped(&self) -> u64 {
        self.dropped.load(Ordering::Relaxed)
    }

    /// Says where this bridge stands, for who asks.
    pub fn set_status(&self, text: String) {
        *self.status.lock().unwrap_or_else(PoisonError::into_inner) = text;
    }
}
