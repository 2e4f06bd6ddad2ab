//! Exceptions: faults, entry, return, sleep (ARM DDI 0403E, B1.5).
//!
//! Entry has two steps. The frame is stacked, then the handler is chosen and its vector fetched. The board can run
//! between the two: an exception of a higher priority that arrives meanwhile is taken with the existing frame (late
//! arrival, B1.5.12). An exception that is pending at the return of another is taken without unstacking
//! (tail-chaining).

use super::bus::Bus;
use super::fault::{Fault, Trap, exception};
use super::nvic::THREAD_PRIORITY;
use super::op::Reg;
use super::state::{Cpu, Sleep, ccr, control, scr};

/// EXC_RETURN: to a handler with the main stack, to a thread with the main stack, to a thread with its own.
const RETURN_TO_HANDLER: u32 = 0xffff_fff1;
const RETURN_TO_THREAD_MAIN: u32 = 0xffff_fff9;
const RETURN_TO_THREAD_PROCESS: u32 = 0xffff_fffd;

/// Bytes of a stack frame without floating-point registers.
const FRAME: u32 = 32;

/// Bit 9 of the stacked xPSR: the stack pointer was not a multiple of eight.
const FRAME_PADDED: u32 = 1 << 9;

impl Cpu {
    /// The pending exception that must be taken now, if any.
    pub(super) fn due_exception(&self) -> Option<u16> {
        let first = self.nvic.first_pending()?;
        let priority = self.nvic.group_priority(self.nvic.priority(first));
        (priority < self.execution_priority()).then_some(first)
    }

    /// Records a fault and pends its exception (B1.5.14). Escalates it to HardFault if the exception is disabled or its
    /// priority does not suffice, and then to lockup if that does not suffice either (B1.5.15).
    pub(super) fn raise(&mut self, fault: Fault) {
        self.request_service();
        self.scb.cfsr |= fault.cfsr();
        self.scb.hfsr |= fault.hfsr();
        match fault {
            Fault::DataBus(address) => self.scb.bfar = address,
            Fault::DataProtection(address) => self.scb.mmfar = address,
            _ => {}
        }
        self.pend_synchronous(fault.exception());
    }

    /// Pends an exception that an instruction causes, or the HardFault that it escalates to.
    fn pend_synchronous(&mut self, number: u16) {
        self.request_service();
        let priority = self.nvic.group_priority(self.nvic.priority(number));
        let current = self.execution_priority();
        if self.nvic.is_enabled(number) && priority < current {
            self.nvic.pend(number);
        } else if current > self.nvic.priority(exception::HARD_FAULT) {
            if number != exception::HARD_FAULT {
                self.scb.hfsr |= 1 << 30;
            }
            self.nvic.pend(exception::HARD_FAULT);
        } else {
            self.lockup = true;
        }
    }

    /// Handles a trap of an instruction. `next` is the address of the instruction after it.
    #[cold]
    pub(super) fn handle(&mut self, bus: &mut dyn Bus, trap: Trap, next: u32) {
        self.request_service();
        match trap {
            Trap::Fault(fault) => self.raise(fault),
            Trap::Refused(refusal) => self.refused = Some(refusal),
            Trap::SupervisorCall => {
                self.r[15] = next;
                self.pend_synchronous(exception::SV_CALL);
            }
            Trap::ExceptionReturn(value) => self.return_from_exception(bus, value),
        }
    }

    /// ExceptionEntry(), its first step: PushStack() (B1.5.6).
    pub(super) fn stack_frame(&mut self, bus: &mut dyn Bus) {
        let sp = self.get(Reg::SP);
        let aligned = self.scb.ccr & ccr::STKALIGN != 0;
        let padding = if aligned { sp & 4 } else { 0 };
        let frame = sp.wrapping_sub(FRAME + padding);
        let return_value = match (self.exception != 0, self.uses_process_stack()) {
            (true, _) => RETURN_TO_HANDLER,
            (false, false) => RETURN_TO_THREAD_MAIN,
            (false, true) => RETURN_TO_THREAD_PROCESS,
        };
        let xpsr = self.xpsr() | if padding != 0 { FRAME_PADDED } else { 0 };
        let [r0, r1, r2, r3] = [0, 1, 2, 3].map(|n| self.r[n]);
        let words = [r0, r1, r2, r3, self.r[12], self.r[14], self.r[15], xpsr];
        for (address, word) in (frame..).step_by(4).zip(words) {
            if let Err(trap) = self.store::<4>(bus, address, word) {
                let fault = match trap {
                    Trap::Fault(Fault::DataProtection(_)) => Fault::StackProtection,
                    _ => Fault::StackBus,
                };
                self.raise(fault);
                break;
            }
        }
        self.set(Reg::SP, frame);
        self.set(Reg::LR, return_value);
        self.entering = true;
        self.cycle += self.clock.entry;
    }

    /// ExceptionEntry(), its second step: ExceptionTaken() (B1.5.6).
    pub(super) fn take_exception(&mut self, bus: &mut dyn Bus, number: u16) {
        self.entering = false;
        let vector = self.scb.vtor.wrapping_add(4 * u32::from(number));
        self.change_mode(number, self.control & !control::PROCESS_STACK);
        self.nvic.activate(number);
        self.it = 0;
        self.exclusive = false;
        self.event = true;
        self.sleep = Sleep::Awake;
        self.cycle += self.clock.vector;
        match self.load::<4>(bus, vector) {
            Ok(start) => {
                self.r[15] = start & !1;
                // Without the T bit, the first instruction is an INVSTATE fault.
                self.thumb = start & 1 != 0;
            }
            Err(_) => self.raise(Fault::Vector),
        }
        self.request_service();
    }

    /// ExceptionReturn() (B1.5.8).
    fn return_from_exception(&mut self, bus: &mut dyn Bus, value: u32) {
        let returning = self.exception;
        let nested = self.nvic.active_count();
        let to_thread = value & 8 != 0;
        let valid_value = matches!(
            value,
            RETURN_TO_HANDLER | RETURN_TO_THREAD_MAIN | RETURN_TO_THREAD_PROCESS
        );
        let valid_nesting = match to_thread {
            false => nested != 1,
            true => nested == 1 || self.scb.ccr & ccr::NONBASETHRDENA != 0,
        };
        let was_active = self.nvic.is_active(returning);
        self.nvic.set_active(returning, false);
        if returning != exception::NMI {
            self.faultmask = false;
        }
        if !was_active || !valid_value || !valid_nesting {
            return self.fail_return(value, Fault::InvalidReturn);
        }
        self.event = true;
        self.exclusive = false;
        if let Some(next) = self.due_exception() {
            // Tail-chaining.
            self.set(Reg::LR, value);
            self.cycle += self.clock.tail_chain;
            return self.take_exception(bus, next);
        }
        self.unstack_frame(bus, value, to_thread);
    }

    /// PopStack() (B1.5.8).
    fn unstack_frame(&mut self, bus: &mut dyn Bus, value: u32, to_thread: bool) {
        let frame = if value == RETURN_TO_THREAD_PROCESS {
            self.process_sp()
        } else {
            self.main_sp()
        };
        let mut words = [0; 8];
        for (address, word) in (frame..).step_by(4).zip(&mut words) {
            match self.load::<4>(bus, address) {
                Ok(read) => *word = read,
                Err(Trap::Fault(Fault::DataProtection(_))) => {
                    return self.fail_return(value, Fault::UnstackProtection);
                }
                Err(_) => return self.fail_return(value, Fault::UnstackBus),
            }
        }
        let [r0, r1, r2, r3, r12, lr, pc, xpsr] = words;
        let exception = (xpsr & 0x1ff) as u16;
        if to_thread != (exception == 0) {
            return self.fail_return(value, Fault::InvalidReturn);
        }
        let process = if value == RETURN_TO_THREAD_PROCESS {
            control::PROCESS_STACK
        } else {
            0
        };
        self.change_mode(exception, self.control & !control::PROCESS_STACK | process);
        self.r[..4].copy_from_slice(&[r0, r1, r2, r3]);
        self.r[12] = r12;
        self.r[14] = lr;
        self.r[15] = pc & !1;
        let padding = if xpsr & FRAME_PADDED != 0 && self.scb.ccr & ccr::STKALIGN != 0 {
            4
        } else {
            0
        };
        self.set(Reg::SP, frame.wrapping_add(FRAME) | padding);
        self.set_xpsr(xpsr);
        self.cycle += self.clock.exit;
        if to_thread && self.scb.scr & scr::SLEEPONEXIT != 0 {
            self.sleep = Sleep::Interrupt;
        }
    }

    /// A fault during an exception return is taken without unstacking: the handler returns to the same frame.
    fn fail_return(&mut self, value: u32, fault: Fault) {
        self.set(Reg::LR, value);
        self.raise(fault);
        self.entering = true;
    }

    /// WFE: sleeps, unless there was an event (B1.5.18).
    pub(super) fn wait_for_event(&mut self) {
        if !std::mem::take(&mut self.event) {
            self.sleep = Sleep::Event;
            self.request_service();
        }
    }

    /// WFI: sleeps (B1.5.19).
    pub(super) fn wait_for_interrupt(&mut self) {
        self.sleep = Sleep::Interrupt;
        self.request_service();
    }

    /// Wakes the core if there is a reason. An exception masked by PRIMASK ends WFI, but not WFE.
    pub(super) fn wake(&mut self) {
        if self.nvic.take_newly_pending() && self.scb.scr & scr::SEVONPEND != 0 {
            self.event = true;
        }
        let wakes = match self.sleep {
            Sleep::Awake => false,
            Sleep::Interrupt => self.has_wakeup_exception(),
            Sleep::Event => std::mem::take(&mut self.event) || self.due_exception().is_some(),
        };
        if wakes {
            self.sleep = Sleep::Awake;
        }
    }

    /// Returns true if a pending exception has a priority above the current one, ignoring PRIMASK (B1.5.17).
    fn has_wakeup_exception(&self) -> bool {
        let Some(first) = self.nvic.first_pending() else {
            return false;
        };
        let mut current = self.nvic.active_priority().min(THREAD_PRIORITY);
        if self.basepri != 0 {
            current = current.min(self.nvic.group_priority(self.basepri.into()));
        }
        if self.faultmask {
            current = current.min(-1);
        }
        self.nvic.group_priority(self.nvic.priority(first)) < current
    }
}
