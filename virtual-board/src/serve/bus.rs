//! A CAN bus without a board, in real time.

use std::path::PathBuf;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};
use std::time::Instant;

use armwire_sim::pty::{self, Pty};

use super::can::CanPort;
use super::{MAX_SLEEP, print_line, stop_at};
use crate::board::Can;
use crate::can::absent::Absent;
use crate::can::bus::Bus;
use crate::error::Error;
use crate::shared::lock;
use crate::time::Nanos;

/// Serves a CAN bus with SLCAN adapters, each an FD node, until Ctrl-C. Each adapter is a pty with a symbolic link.
///
/// # Errors
///
/// If no pty is available, or a link cannot be created.
pub fn serve_bus(links: &[PathBuf]) -> Result<(), Error> {
    let stop = Arc::new(AtomicBool::new(false));
    stop_at(stop.clone())?;
    let open = |link: &PathBuf| Pty::open(Some(link)).map_err(Error::Serve);
    let ptys = links.iter().map(open).collect::<Result<Vec<_>, _>>()?;
    let mut ports: Vec<_> = (0..).zip(ptys).map(|(node, pty)| CanPort::new(pty, node)).collect();
    let bus = Mutex::new(Bus::default());
    let can = Can { bus: &bus };
    let (start, mut at) = (Instant::now(), Nanos(0));
    print_line("serving a CAN bus; Ctrl-C ends it");
    while !stop.load(Ordering::Relaxed) {
        let now = Nanos(u64::try_from(start.elapsed().as_nanos()).unwrap_or(u64::MAX));
        for port in &mut ports {
            port.take(&can, now)?;
        }
        while let Some(next) = lock(&bus).poll(at, &mut Absent).filter(|&next| next <= now) {
            at = next;
        }
        at = now;
        for port in &mut ports {
            port.give(&can, now)?;
        }
        // Records of an endless run must not accumulate.
        can.forget_frames();
        let ptys: Vec<_> = ports.iter().map(CanPort::pty).collect();
        pty::wait_for_any(&ptys, Some(MAX_SLEEP)).map_err(Error::Serve)?;
    }
    Ok(())
}
