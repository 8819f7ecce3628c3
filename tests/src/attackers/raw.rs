//! A client that writes its own headers.
#![allow(unsafe_code)]

use std::path::PathBuf;
use std::time::{Duration, Instant};

use pairmask_core::engine::EngineChoice;
use pairmask_core::precision::BoxForm;
use pairmask_core::units::BoxCount;
use pairmask_transport::{
    Client, PendingResponse, RequestLoan, RuntimeDir, Services, assume_pages,
};
use pairmask_wire::{CullRequest, InstanceName, RequestHeader, ResponseHeader, SceneSections};
use pairmaskd::scene::Random;

/// Index of the client's id, two words, in the transport's header of a request. All indices here count
/// words of 8 bytes of that header.
pub const CLIENT_ID: usize = 2;
/// Index of the channel on which the answer is expected.
pub const CHANNEL_ID: usize = 4;
pub const REQUEST_ID: usize = 5;
pub const PAGE_COUNT: usize = 6;
pub const SENT_BYTES: usize = 64;

pub struct RawClient {
    pub ports: Client,
    pub services: Services,
}

impl RawClient {
    /// Connects to the daemon of the environment's directory, if it serves.
    pub fn connect(token: u64, pages: usize) -> Option<Self> {
        Self::connect_at(&RuntimeDir::from_env(), token, pages)
    }

    /// As [`Self::connect`], in another directory.
    pub fn connect_at(dir: &RuntimeDir, token: u64, pages: usize) -> Option<Self> {
        let name = InstanceName::default();
        dir.read_record(&name)?;
        let services = Services::connect(dir, &name).ok()?;
        let ports = services.client(token, pages).ok()?;
        Some(Self { ports, services })
    }

    /// As [`Self::connect`], as soon as there is a daemon.
    pub fn reconnect(token: u64, pages: usize, until: &super::Until) -> Option<Self> {
        while !until.is_over() {
            if let Some(client) = Self::connect(token, pages) {
                return Some(client);
            }
            std::thread::sleep(Duration::from_millis(5));
        }
        None
    }

    pub fn loan(&self, pages: usize) -> Option<RequestLoan> {
        self.ports.port.loan_slice_uninit(pages).ok().map(assume_pages)
    }

    pub fn send(&self, loan: RequestLoan) -> Option<PendingResponse> {
        let pending = loan.send().ok()?;
        let _ = self.ports.notifier.notify();
        Some(pending)
    }
}

pub fn cull(token: u64, frame: u64, n: u32, engine: EngineChoice) -> RequestHeader {
    let scene = SceneSections::first(BoxForm::F32, BoxCount::new(n));
    let request = CullRequest { engine, threads: Some(1), ..CullRequest::of(scene) };
    RequestHeader::cull(token, frame, &request)
}

pub fn answer(pending: &PendingResponse, within: Duration) -> Option<ResponseHeader> {
    let give_up_at = Instant::now() + within;
    loop {
        if let Ok(Some(response)) = pending.receive() {
            return Some(*response.user_header());
        }
        if Instant::now() >= give_up_at {
            return None;
        }
        std::thread::sleep(Duration::from_micros(50));
    }
}

pub fn word<H>(header: &H, index: usize) -> usize {
    std::ptr::from_ref(header) as usize + 8 * index
}

pub fn write(address: usize, value: u64) {
    // SAFETY: callers take the address from a message of their own, which they still hold, and whose
    // memory is mapped for writing; other processes treat it as shared memory.
    unsafe { std::ptr::with_exposed_provenance_mut::<u64>(address).write_volatile(value) }
}

pub fn read(address: usize) -> u64 {
    // SAFETY: as in `write`.
    unsafe { std::ptr::with_exposed_provenance::<u64>(address).read_volatile() }
}

pub fn segment_file(port: u128) -> Option<PathBuf> {
    let prefix = RuntimeDir::from_env().shm_prefix(&InstanceName::default());
    let ending = format!("_{port}.data");
    let is_its = |name: &str| name.starts_with(&prefix) && name.ends_with(&ending);
    let mut files = std::fs::read_dir("/dev/shm").ok()?.flatten();
    files.find(|file| file.file_name().to_str().is_some_and(is_its)).map(|file| file.path())
}

/// Numbers of chance, others in each process.
pub fn dice() -> Random {
    Random::new(u64::from(std::process::id()))
}
