//! Mutations: defects injected to test the invariants.

use armwire::ling::{GripperSpeed, JOINTS, Ling, MAX_FRAME, Move, Opening, Position, Request, Speed};
use armwire::messages::Messages;
use armwire_virtual_board::line::Fault as LineFault;

use super::super::{Ticket, facts};
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
                let chip = facts(self.board.chip());
                let before = self.traffic.unreceived;
                self.board.write_word(chip.uart_control, chip.uart_deaf)?;
                self.await_fault(&mut |rig| rig.traffic.unreceived > before)?;
                self.board.write_word(chip.uart_control, chip.uart_listening)?;
            }
            Mutation::ExtraErrorCount => {
                self.plan(LineFault::Framing)?;
                // The recorded traffic has no framing error.
                self.traffic.framing_faults -= 1;
            }
            Mutation::ForgedAnswer => {
                let ticket = Ticket {
                    initiator: 1,
                    number: u32::MAX,
                };
                if let Some(can) = &mut self.hosts.can {
                    can.tracker.strays.push(ticket.request());
                }
            }
            Mutation::UnrequestedMove => {
                let target = Move {
                    joints: [(Position::CENTRE, Speed::MAX); JOINTS],
                    gripper: (Opening::CLOSED, GripperSpeed(1_000)),
                };
                let mut motion = [0; MAX_FRAME];
                let len = Ling
                    .encode_request(&Request::Move(target), &mut motion)
                    .map_err(|error| format!("{error:?}"))?;
                self.board.usb().write(&motion[..len])?;
            }
            Mutation::UnexpectedRestart => {
                self.disconnect_usb();
                self.board.power_cycle()?;
                self.set_up_again()?;
                self.finish()?;
                self.reset_accounting();
                self.resume()?;
            }
            Mutation::SilentArm => self.board.with_arm(|cable| cable.arm().set_silent(true)),
        }
        Ok(())
    }
}
