//! A client: one session, through however many ports.

use iceoryx2::port::notifier::ListenerKey;
use iceoryx2::prelude::CallbackProgression;
use pairmask_transport::{WakeClient, listener_name};

use super::scenes::KeptScene;
use super::work::LastWork;
use crate::execute::Executor;

/// What is kept of a client. Everything that belongs to one session and outlives a request goes here.
pub(super) struct Client {
    session: u128,
    /// The number of the last look for it.
    pub(super) looked_at: u64,
    /// What wakes it, once it was found.
    pub(super) listener: Option<ListenerKey>,
    /// Pairs in its last frame, once it had one.
    pub(super) last_pairs: Option<u64>,
    /// What its last requests took.
    pub(super) last_work: LastWork,
    /// Its engines, while no frame of it is being culled.
    pub(super) engines: Option<Box<Executor>>,
    /// Its scenes, but for one that is being changed.
    pub(super) scenes: Vec<KeptScene>,
}

impl Client {
    /// A client of which nothing is known yet.
    pub(super) fn new(session: u128) -> Self {
        Self {
            session,
            looked_at: 0,
            listener: None,
            last_pairs: None,
            last_work: LastWork::default(),
            engines: None,
            scenes: Vec::new(),
        }
    }

    /// Its session, by the transport's number of the node.
    pub(super) const fn session(&self) -> u128 {
        self.session
    }
}

/// The listener of a session that bears the name of this token.
pub(super) fn find_listener(
    notifier: &WakeClient,
    session: u128,
    client_token: u64,
) -> Option<ListenerKey> {
    let name = listener_name(client_token)?;
    let mut found = None;
    notifier.for_each_listener(|listener, details| {
        if details.listener_name == name && details.node_id.value() == session {
            found = Some(listener.listener_key());
            return CallbackProgression::Stop;
        }
        CallbackProgression::Continue
    });
    found
}
