//! The services of an instance and the ports on them: what both sides open, in one file, since their settings have to
//! agree.

use std::hash::{BuildHasher, Hasher, RandomState};
use std::mem::MaybeUninit;
use std::sync::Arc;
use std::sync::atomic::{AtomicBool, Ordering};
use std::time::Duration;

use iceoryx2::config::Config;
use iceoryx2::identifiers::UniqueNodeId;
use iceoryx2::node::{Node, NodeBuilder, NodeCreationFailure};
use iceoryx2::port::listener::{Listener, ListenerCreateError};
use iceoryx2::port::notifier::{Notifier, NotifierCreateError};
use iceoryx2::port::port_name::PortName;
use iceoryx2::port::{DegradationAction, DegradationCause, DegradationInfo, client, server};
use iceoryx2::prelude::{
    AllocationStrategy, BackpressureStrategy, CallbackProgression, FileName, Path, PortFactory,
    SemanticString, ServiceName, SignalHandlingMode,
};
use iceoryx2::service::builder::event::{EventOpenError, EventOpenOrCreateError};
use iceoryx2::service::builder::request_response as requests;
use iceoryx2::service::builder::request_response::{
    RequestResponseOpenError, RequestResponseOpenOrCreateError,
};
use iceoryx2::service::dynamic_config::request_response::ServerDetails;
use iceoryx2::service::ipc_threadsafe;
use iceoryx2::service::port_factory::client::ClientCreateError;
use iceoryx2::service::port_factory::{event, request_response};
use iceoryx2::{
    active_request, pending_response, request_mut, request_mut_uninit, response, response_mut,
    response_mut_uninit,
};
use pairmask_wire::{InstanceName, PAGE_BYTES, Page, RequestHeader, ResponseHeader};

use crate::instance::{RuntimeDir, segment_files};
use crate::process_limits::{self, LimitError};
use crate::room;
use crate::umask::with_own_umask;

/// The transport of both sides: sessions may move between threads, and the daemon serves from several.
pub(super) type Ipc = ipc_threadsafe::Service;
type Pages = [Page];
type UninitPages = [MaybeUninit<Page>];

/// A node of the daemon.
pub type DaemonNode = Node<Ipc>;
/// The daemon's end of the request service. Its threads take turns at it, see
/// [`PortTurn`](crate::PortTurn).
pub type Server = server::Server<Ipc, Pages, RequestHeader, Pages, ResponseHeader>;
/// A request that the daemon has received.
pub type ActiveRequest =
    active_request::ActiveRequest<Ipc, Pages, RequestHeader, Pages, ResponseHeader>;
/// Memory for a response, fresh from the port.
pub(super) type UninitResponse =
    response_mut_uninit::ResponseMutUninit<Ipc, UninitPages, ResponseHeader>;
/// Memory for a response.
pub type ResponseLoan = response_mut::ResponseMut<Ipc, Pages, ResponseHeader>;
/// A client's end of the request service.
pub type ClientPort = client::Client<Ipc, Pages, RequestHeader, Pages, ResponseHeader>;
/// Memory for a request, fresh from the port.
pub(super) type UninitRequest =
    request_mut_uninit::RequestMutUninit<Ipc, UninitPages, RequestHeader, Pages, ResponseHeader>;
/// Memory for a request.
pub type RequestLoan = request_mut::RequestMut<Ipc, Pages, RequestHeader, Pages, ResponseHeader>;
/// A request under way.
pub type PendingResponse =
    pending_response::PendingResponse<Ipc, Pages, RequestHeader, Pages, ResponseHeader>;
/// A response that the client has received.
pub type ResponseSample = response::Response<Ipc, Pages, ResponseHeader>;

/// The listener by which clients wake the daemon, or the daemon a client.
pub type WakeDaemon = Listener<Ipc>;
/// The notifier by which the daemon wakes clients.
pub type WakeClient = Notifier<Ipc>;

/// Limits of an instance. The daemon fixes them when it creates the services.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Limits {
    /// Clients at a time. Each costs the daemon a mapping and a few kilobytes.
    pub max_clients: usize,
    /// Bytes of the largest mask. Address space, not memory: pages cost when they are touched.
    pub max_reply_bytes: u64,
    /// Bytes that all scenes together may take.
    pub max_scene_bytes: u64,
}

impl Limits {
    /// Replies that may be held at a time.
    const fn reply_count(&self) -> usize {
        self.max_clients * FRAMES_AT_A_TIME + SPARE_RESPONSES + KEPT_RESPONSES
    }

    /// Bytes of address space that replies reserve, here and in each client.
    pub const fn address_space(&self) -> u64 {
        self.max_reply_bytes.saturating_mul(self.reply_count() as u64)
    }

    /// Limits whose replies fit into so many bytes of address space.
    #[must_use]
    pub fn within(self, address_space: u64) -> Self {
        // Less than a page lies between two of them, and before the first.
        let each = address_space / self.reply_count() as u64;
        let page_bytes = PAGE_BYTES as u64;
        let fits = (each / page_bytes).saturating_sub(2) * page_bytes;
        Self { max_reply_bytes: self.max_reply_bytes.min(fits), ..self }
    }
}

impl Default for Limits {
    /// 16 clients; masks of 1 GiB: the dense mask of 131,000 boxes, or 80 million sparse words; scenes of
    /// 4 GiB: 14 million boxes.
    fn default() -> Self {
        Self { max_clients: 16, max_reply_bytes: 1 << 30, max_scene_bytes: 4 << 30 }
    }
}

/// Frames that a client may have at a time, in any mix of being filled, under way, and held as
/// masks: two under way overlap upload, computation and download; the third is filled meanwhile.
pub const FRAMES_AT_A_TIME: usize = 3;
/// Ports a client may hold: while it grows, the old port lives until its frames are answered.
pub const PORTS_PER_CLIENT: usize = 2;
/// Response chunks beside those that clients may hold: a growing client holds some on both ports.
/// When they are used up, a client gets the status out-of-memory.
const SPARE_RESPONSES: usize = 4;
/// Response chunks that the daemon holds while it gives their pages back: one at a time.
const KEPT_RESPONSES: usize = 1;
/// Client ports of the daemon itself, for its free chunks.
const OWN_PORTS: usize = 1;
/// Loans of one request. Answers have one at a time; the request for free chunks has up to all at once, and one more
/// for each time that it found none: the transport counts a loan that failed. So it is a number that is never reached,
/// and no memory.
const LOANS_A_REQUEST: usize = 1 << 24;
/// Nodes of the daemon: the server's, the janitor's, and those of a predecessor not yet cleaned.
const DAEMON_NODES: usize = 4;

const WAKE_DAEMON_SERVICE: &str = "pairmask/wake-daemon";
const WAKE_CLIENT_SERVICE: &str = "pairmask/wake-client";

/// Why a client cannot connect.
#[derive(Debug, thiserror::Error)]
pub enum OpenError {
    /// No daemon has created the services.
    #[error("no daemon serves this instance")]
    NotServed,
    /// The services speak another layout.
    #[error("the daemon's services have another layout")]
    Incompatible,
    /// Every client slot is taken.
    #[error("the daemon already has all the clients that it may have")]
    TooManyClients,
    /// No shared memory.
    #[error("no shared memory for a segment: free space in /dev/shm or make it larger")]
    OutOfMemory,
    /// Files of the services no longer exist, or are not finished.
    #[error("the daemon's files in /dev/shm were removed")]
    FilesRemoved,
    /// A limit of this process.
    #[error(transparent)]
    Limit(#[from] LimitError),
    /// The transport failed in another way.
    #[error(transparent)]
    Transport(#[from] TransportError),
}

impl OpenError {
    /// A step that failed: by a limit of this process, where one is reached, else as `or` says.
    fn of_step(bytes: u64, or: Self) -> Self {
        process_limits::behind(bytes).map_or(or, Self::Limit)
    }
}

/// A step of the transport that failed.
#[derive(Clone, Debug, thiserror::Error)]
#[error("transport: {step} failed ({detail})")]
pub struct TransportError {
    /// The step that was tried.
    pub step: &'static str,
    /// The transport's own error, as text.
    pub detail: String,
}

impl TransportError {
    /// An error of a step, with the transport's error.
    pub fn new(step: &'static str, detail: &impl std::fmt::Debug) -> Self {
        Self { step, detail: format!("{detail:?}") }
    }
}

/// The three services of an instance, opened or created by one node.
#[derive(Debug)]
pub struct Services {
    requests: request_response::PortFactory<Ipc, Pages, RequestHeader, Pages, ResponseHeader>,
    wake_daemon: event::PortFactory<Ipc>,
    wake_client: event::PortFactory<Ipc>,
    node: Node<Ipc>,
}

/// A client's ports.
#[derive(Debug)]
pub struct Client {
    /// Sends requests.
    pub port: ClientPort,
    /// Wakes the daemon.
    pub notifier: Notifier<Ipc>,
    /// Is woken by the daemon.
    pub listener: Listener<Ipc>,
}

/// Limits the transport's log to the level in `IOX2_LOG_LEVEL`: a failed attempt to connect is an
/// everyday event here, and a typed error.
pub fn quiet_transport_log() {
    iceoryx2::prelude::set_log_level_from_env_or(iceoryx2::prelude::LogLevel::Fatal);
}

/// Name of the listener that the daemon wakes for a client.
pub fn listener_name(client_token: u64) -> Option<PortName> {
    PortName::new(&format!("{client_token:016x}")).ok()
}

pub(super) fn config(dir: &RuntimeDir, name: &InstanceName) -> Result<Config, TransportError> {
    let mut config = Config::default();
    let bad = |e| TransportError::new("naming the transport's files", &e);
    config.global.prefix = FileName::new(dir.shm_prefix(name).as_bytes()).map_err(bad)?;
    let root = dir.transport_root(name);
    let root = Path::new(root.as_os_str().as_encoded_bytes()).map_err(bad)?;
    config.global.set_root_path(&root);
    // Only the daemon's janitor cleans up: clients that clean while they start and stop race each
    // other (68 of 200 killed clients left entries behind, against 11 with this).
    config.global.node.cleanup_dead_nodes_on_creation = false;
    config.global.node.cleanup_dead_nodes_on_destruction = false;
    config.global.service.cleanup_dead_nodes_on_open = false;
    Ok(config)
}

fn node(dir: &RuntimeDir, name: &InstanceName) -> Result<Node<Ipc>, TransportError> {
    NodeBuilder::new()
        .config(&config(dir, name)?)
        // The program handles signals, not the transport.
        .signal_handling_mode(SignalHandlingMode::Disabled)
        .create::<Ipc>()
        .map_err(|e: NodeCreationFailure| TransportError::new("creating a node", &e))
}

fn service_name(name: &str) -> Result<ServiceName, TransportError> {
    ServiceName::new(name).map_err(|e| TransportError::new("naming a service", &e))
}

/// The request service, as both sides need it.
fn requests_of(
    node: &Node<Ipc>,
) -> Result<requests::Builder<Pages, RequestHeader, Pages, ResponseHeader, Ipc>, TransportError> {
    Ok(node
        .service_builder(&service_name("pairmask/requests")?)
        .request_response::<Pages, Pages>()
        .request_user_header::<RequestHeader>()
        .response_user_header::<ResponseHeader>()
        // Overflow would drop a frame; fire-and-forget would leave stale responses.
        .enable_safe_overflow_for_requests(false)
        .enable_safe_overflow_for_responses(false)
        .enable_fire_and_forget_requests(false)
        .max_active_requests_per_client(FRAMES_AT_A_TIME)
        .max_loaned_requests(FRAMES_AT_A_TIME))
}

impl Services {
    /// The node that holds the services.
    pub const fn owner(&self) -> &DaemonNode {
        &self.node
    }

    /// Number of clients that are connected.
    pub fn client_count(&self) -> usize {
        self.wake_client.dynamic_config().number_of_listeners()
    }

    /// Calls `each` with the sender of every client port, but for those of its own node.
    pub fn for_each_sender(&self, mut each: impl FnMut(Sender)) {
        self.requests.dynamic_config().list_clients(|client| {
            if client.node_id == *self.node.id() {
                return CallbackProgression::Continue;
            }
            each(Sender {
                port: client.client_id.value(),
                session: client.node_id.value(),
                process: process_of(client.node_id).unwrap_or(0),
            });
            CallbackProgression::Continue
        });
    }

    /// The session whose listener is named by a client's token, if there is one.
    pub fn session_named(&self, client_token: u64) -> Option<u128> {
        let name = listener_name(client_token)?;
        let mut found = None;
        self.wake_client.dynamic_config().list_listeners(|listener| {
            if listener.listener_name == name {
                found = Some(listener.node_id.value());
                return CallbackProgression::Stop;
            }
            CallbackProgression::Continue
        });
        found
    }

    /// The process whose server port is registered, if there is one.
    pub fn serving_process(&self) -> Option<u32> {
        self.of_server(|server| process_of(server.node_id))
    }

    fn of_server<T>(&self, of: impl Fn(&ServerDetails) -> Option<T>) -> Option<T> {
        let mut found = None;
        self.requests.dynamic_config().list_servers(|server| {
            found = of(server);
            CallbackProgression::Stop
        });
        found
    }
}

/// Numbers that a client port may begin at. More would make it rarer still that two clients use the same one, and a
/// connection slower: 0.1 µs each.
const FIRST_NUMBERS: u64 = 1 << 14;

/// Has a port number its requests from anywhere.
///
/// The transport numbers the requests of each port from 0, and gives the place of a disconnected client to the next
/// one. It distinguishes an answer to the one from an answer to the other by the number alone: a client that takes the place of
/// one that was killed would get what the daemon has yet to send to that one, and would have its own request dropped
/// with that one's.
fn skip_numbers(port: &ClientPort) {
    for _ in 0..RandomState::new().build_hasher().finish() % FIRST_NUMBERS {
        // A loan takes a number, whether or not it is sent. Where there is no memory for it, the first frame will show.
        drop(port.loan_slice_uninit(1));
    }
}

impl Services {
    /// A node for the janitor thread.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn janitor_node(
        dir: &RuntimeDir,
        name: &InstanceName,
    ) -> Result<DaemonNode, TransportError> {
        node(dir, name)
    }

    /// Creates the services, or takes over those of a daemon that died while clients live on.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn serve(
        dir: &RuntimeDir,
        name: &InstanceName,
        limits: &Limits,
    ) -> Result<Self, TransportError> {
        room::for_ports()
            .map_err(|full| TransportError { step: "making services", detail: full.to_string() })?;
        let node = node(dir, name)?;
        let max_nodes = limits.max_clients + DAEMON_NODES;
        let requests = requests_of(&node)?
            .max_servers(1)
            .max_clients(limits.max_clients * PORTS_PER_CLIENT + OWN_PORTS)
            .max_nodes(max_nodes)
            .max_response_buffer_size(1)
            .max_borrowed_responses_per_pending_response(1)
            .open_or_create()
            .map_err(|e: RequestResponseOpenOrCreateError| {
                TransportError::new("creating the request service", &e)
            })?;
        let event = |service: &str, notifiers, listeners| {
            node.service_builder(&service_name(service)?)
                .event()
                .max_nodes(max_nodes)
                .max_notifiers(notifiers)
                .max_listeners(listeners)
                .open_or_create()
                .map_err(|e: EventOpenOrCreateError| {
                    TransportError::new("creating a wake-up service", &e)
                })
        };
        // Two on the daemon's side: a predecessor's port may remain until the janitor removes it.
        let wake_daemon = event(WAKE_DAEMON_SERVICE, limits.max_clients, 2)?;
        let wake_client = event(WAKE_CLIENT_SERVICE, 2, limits.max_clients)?;
        Ok(Self { requests, wake_daemon, wake_client, node })
    }

    /// The server port. Its segment reserves address space for `limits.max_reply_bytes` a chunk. It sets
    /// `has_no_files` where it cannot be connected to a client because this process can open no more files:
    /// that client's requests are never received.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn server(
        &self,
        limits: &Limits,
        has_no_files: &Arc<AtomicBool>,
    ) -> Result<Server, TransportError> {
        let pages = pairmask_wire::page_count(limits.max_reply_bytes);
        let chunks = limits.reply_count();
        let note_files = || {
            let noted = Arc::clone(has_no_files);
            move |_: DegradationCause, _: &DegradationInfo| {
                noted.fetch_or(process_limits::no_files_left().is_some(), Ordering::Relaxed);
                DegradationAction::Warn
            }
        };
        self.requests
            .server_builder()
            .set_request_degradation_handler(note_files())
            .set_response_degradation_handler(note_files())
            // The default blocks the daemon when a client does not take its responses.
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            // Dynamic growth is broken for alignments over 8 bytes.
            .allocation_strategy(AllocationStrategy::Static)
            .initial_max_slice_len(usize::try_from(pages).unwrap_or(usize::MAX))
            .max_loaned_responses_per_request(LOANS_A_REQUEST)
            // The transport's own worst case is twelve times this, 600 GiB of address space.
            .override_response_preallocation(move |worst| worst.min(chunks))
            .create()
            .map_err(|e| {
                let step = "creating the server port";
                match process_limits::behind(limits.address_space()) {
                    Some(limit) => TransportError { step, detail: limit.to_string() },
                    None => TransportError::new(step, &e),
                }
            })
    }

    /// The listener that clients wake, and the notifier that wakes clients.
    ///
    /// # Errors
    /// [`TransportError`].
    pub fn wake_ports(&self) -> Result<(WakeDaemon, WakeClient), TransportError> {
        let listener = with_own_umask(|| self.wake_daemon.listener_builder().create())
            .map_err(|e| TransportError::new("creating the daemon's listener", &e))?;
        let notifier = self
            .wake_client
            .notifier_builder()
            .create()
            .map_err(|e| TransportError::new("creating the daemon's notifier", &e))?;
        Ok((listener, notifier))
    }
}

/// The sender behind a port, by the transport's registers.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Sender {
    /// Id of the port. It is never used again.
    pub port: u128,
    /// Id of the session (node) that the port belongs to.
    pub session: u128,
    /// Id of the session's process; 0 where the register has none.
    pub process: u32,
}

fn process_of(node: UniqueNodeId) -> Option<u32> {
    u32::try_from(node.pid::<Ipc>().ok()?.value()).ok()
}

impl Services {
    /// Opens the services of a daemon.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn connect(dir: &RuntimeDir, name: &InstanceName) -> Result<Self, OpenError> {
        use RequestResponseOpenError as E;
        room::for_ports().map_err(|_| OpenError::OutOfMemory)?;
        let failed = |e: TransportError| OpenError::of_step(0, e.into());
        let node = node(dir, name).map_err(failed)?;
        let requests = requests_of(&node)?.open().map_err(|e| match e {
            E::DoesNotExist => OpenError::NotServed,
            E::HangsInCreation => OpenError::of_step(0, OpenError::FilesRemoved),
            E::ExceedsMaxNumberOfNodes => OpenError::TooManyClients,
            E::IncompatibleRequestOrResponseType
            | E::VersionMismatch
            | E::IncompatibleOverflowBehaviorForRequests
            | E::IncompatibleOverflowBehaviorForResponses
            | E::IncompatibleBehaviorForFireAndForgetRequests
            | E::DoesNotSupportRequestedAmountOfClientRequestLoans
            | E::DoesNotSupportRequestedAmountOfActiveRequestsPerClient => OpenError::Incompatible,
            other => failed(TransportError::new("opening the request service", &other)),
        })?;
        let event = |service: &str| -> Result<_, OpenError> {
            let opened = node.service_builder(&service_name(service)?).event().open();
            opened.map_err(|e| match e {
                EventOpenError::DoesNotExist => OpenError::NotServed,
                EventOpenError::HangsInCreation => OpenError::of_step(0, OpenError::FilesRemoved),
                EventOpenError::ExceedsMaxNumberOfNodes => OpenError::TooManyClients,
                other => failed(TransportError::new("opening a wake-up service", &other)),
            })
        };
        let wake_daemon = event(WAKE_DAEMON_SERVICE)?;
        let wake_client = event(WAKE_CLIENT_SERVICE)?;
        Ok(Self { requests, wake_daemon, wake_client, node })
    }

    /// A port whose chunks hold `max_pages` pages. To grow, make another port: the transport's own
    /// growth is broken for alignments over 8 bytes.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn client_port(&self, max_pages: usize) -> Result<ClientPort, OpenError> {
        room::for_ports().map_err(|_| OpenError::OutOfMemory)?;
        // By default a port goes on without a daemon whose memory it cannot map: it sends, and never gets an
        // answer. A new port does in any case.
        let is_unmapped = Arc::new(AtomicBool::new(false));
        let noted = Arc::clone(&is_unmapped);
        let port = self
            .requests
            .client_builder()
            .backpressure_strategy(BackpressureStrategy::DiscardData)
            .allocation_strategy(AllocationStrategy::Static)
            .initial_max_slice_len(max_pages)
            .set_response_degradation_handler(move |_, _| {
                noted.store(true, Ordering::Relaxed);
                DegradationAction::DegradeAndFail
            })
            .create()
            .map_err(|e| {
                let own_bytes = max_pages.saturating_mul(PAGE_BYTES * FRAMES_AT_A_TIME) as u64;
                match e {
                    ClientCreateError::ExceedsMaxSupportedClients => OpenError::TooManyClients,
                    ClientCreateError::UnableToCreateDataSegment => {
                        OpenError::of_step(own_bytes, OpenError::OutOfMemory)
                    }
                    other => {
                        let error = TransportError::new("creating the client port", &other);
                        OpenError::of_step(own_bytes, error.into())
                    }
                }
            })?;
        if is_unmapped.load(Ordering::Relaxed) {
            return Err(OpenError::of_step(self.answers_bytes(), OpenError::FilesRemoved));
        }
        skip_numbers(&port);
        Ok(port)
    }

    /// Bytes of the daemon's segment for answers, which a client maps as a whole; 0 where it no longer exists.
    fn answers_bytes(&self) -> u64 {
        let port = self.of_server(|server| Some(server.server_id.value()));
        let bytes =
            |port| segment_files("", port).filter_map(|f| Some(f.metadata().ok()?.len())).sum();
        port.map_or(0, bytes)
    }

    /// All ports of a client.
    ///
    /// # Errors
    /// [`OpenError`].
    pub fn client(&self, client_token: u64, max_pages: usize) -> Result<Client, OpenError> {
        let failed = |e: TransportError| OpenError::of_step(0, e.into());
        let name = listener_name(client_token)
            .ok_or_else(|| TransportError::new("naming the listener", &client_token))?;
        let create = || self.wake_client.listener_builder().name(&name).create();
        let listener = with_own_umask(create).map_err(|e| match e {
            ListenerCreateError::ExceedsMaxSupportedListeners => OpenError::TooManyClients,
            other => failed(TransportError::new("creating the listener", &other)),
        })?;
        let notifier = self.wake_daemon.notifier_builder().create().map_err(|e| match e {
            NotifierCreateError::ExceedsMaxSupportedNotifiers => OpenError::TooManyClients,
            other => failed(TransportError::new("creating the notifier", &other)),
        })?;
        Ok(Client { port: self.client_port(max_pages)?, notifier, listener })
    }
}

/// Time between two rounds of the janitor: a dead client's memory is free again within a second.
pub const JANITOR_INTERVAL: Duration = Duration::from_millis(500);
