//! Mutations: defects injected to test the invariants.

use armwire_virtual_board::line::Fault as LineFault;

use super::super::facts;
use super::super::requests::motion;
use super::super::ticket_arm::{CAN, Ticket};
use super::Result;
use super::rig::Rig;

/// A defect of the adapter, real or apparent.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mutation {
    /// The receiver is off until a byte of the arm is lost. The lost bytes are not counted.
    LostBytes,
    /// The firmware's counter of framing errors is one too high.
    ExtraErrorCount,
    /// A host on CAN receives the answer to a request that it never made.
    ForgedAnswer,
    /// The arm receives a motion command.
    UnrequestedMove,
    /// The board restarts.
    UnexpectedRestart,
    /// The arm stops answering.
    SilentArm,
}

impl Rig {
    /// Applies the mutation.
    pub(super) fn mutate(&mut self, mutation: Mutation) -> Result {
        match mutation {
            Mutation::LostBytes => {
                let chip = facts(self.board.chip()).registers();
                let before = self.traffic.unreceived;
                self.board.write_word(chip.uart_control, chip.uart_receiver_off)?;
                self.await_fault(|rig| rig.traffic.unreceived > before)?;
                self.board.write_word(chip.uart_control, chip.uart_receiver_on)?;
            }
            Mutation::ExtraErrorCount => {
                self.plan_line_fault(LineFault::Framing)?;
                // The recorded traffic has no framing error.
                self.traffic.framing_faults -= 1;
            }
            Mutation::ForgedAnswer => {
                let ticket = Ticket {
                    initiator: CAN,
                    number: u32::MAX,
                };
                self.hosts.can.tracker.strays.push(ticket.request());
            }
            Mutation::UnrequestedMove => self.board.usb().write(&motion())?,
            Mutation::UnexpectedRestart => {
                self.disconnect_usb();
                self.board.power_cycle()?;
                self.reconnect_usb();
                self.restart_accounting()?;
            }
            Mutation::SilentArm => self.board.with_arm(|cable| cable.arm.silent = true),
        }
        Ok(())
    }
}
