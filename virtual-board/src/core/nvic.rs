//! States and priorities of exceptions (ARM DDI 0403E, B1.5.4, B3.4): system exceptions and interrupts.

use super::fault::exception;

/// Number of exceptions: the system's, and 240 interrupts.
const EXCEPTIONS: usize = 256;

/// The priority of thread mode: below all configurable ones.
pub(super) const THREAD_PRIORITY: i16 = 256;

/// A set of exceptions by their number.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub(super) struct Set([u64; EXCEPTIONS / 64]);

impl Set {
    pub(super) fn contains(&self, exception: u16) -> bool {
        self.0[word(exception)] >> (exception % 64) & 1 != 0
    }

    pub(super) fn insert(&mut self, exception: u16) {
        self.0[word(exception)] |= 1 << (exception % 64);
    }

    pub(super) fn remove(&mut self, exception: u16) {
        self.0[word(exception)] &= !(1 << (exception % 64));
    }

    pub(super) fn set(&mut self, exception: u16, on: bool) {
        if on {
            self.insert(exception)
        } else {
            self.remove(exception)
        }
    }

    /// Its members in ascending order.
    fn iter(self) -> impl Iterator<Item = u16> {
        (0..).step_by(64).zip(self.0).flat_map(|(first, mut bits)| {
            std::iter::from_fn(move || {
                let bit = bits.trailing_zeros() as u16;
                bits &= bits.wrapping_sub(1);
                (bit < 64).then_some(first + bit)
            })
        })
    }

    /// The 32 interrupts of an NVIC register, number 0 first.
    fn interrupts(&self, register: u16) -> u32 {
        (0..32).fold(0, |bits, bit| {
            let exception = exception::INTERRUPT_0 + 32 * register + bit;
            bits | u32::from(self.contains(exception)) << bit
        })
    }
}

fn word(exception: u16) -> usize {
    usize::from(exception) / 64 % (EXCEPTIONS / 64)
}

/// The interrupt controller.
#[derive(Clone, Debug)]
pub(super) struct Nvic {
    /// Number of interrupts of the chip.
    interrupts: u16,
    /// The implemented bits of a priority.
    priority_mask: u8,
    enabled: Set,
    /// Pended and not yet taken. An interrupt is also pending while its line is high and it is not active.
    latched: Set,
    active: Set,
    lines: Set,
    priorities: [u8; EXCEPTIONS],
    /// AIRCR.PRIGROUP.
    group: u8,
    /// An exception became pending since the last check: an event for WFE with SCR.SEVONPEND.
    newly_pending: bool,
}

impl Nvic {
    pub(super) fn new(interrupts: u16, priority_bits: u8) -> Self {
        let mut enabled = Set::default();
        for always in [
            exception::NMI,
            exception::HARD_FAULT,
            exception::SV_CALL,
            exception::DEBUG_MONITOR,
            exception::PEND_SV,
            exception::SYS_TICK,
        ] {
            enabled.insert(always);
        }
        Self {
            interrupts,
            priority_mask: !(0xff_u32 >> priority_bits) as u8,
            enabled,
            latched: Set::default(),
            active: Set::default(),
            lines: Set::default(),
            priorities: [0; EXCEPTIONS],
            group: 0,
            newly_pending: false,
        }
    }

    /// Returns true if the chip has this exception.
    fn exists(&self, exception: u16) -> bool {
        exception < exception::INTERRUPT_0 + self.interrupts
    }

    /// The priority of an exception: the fixed ones are negative (B1.5.4).
    pub(super) fn priority(&self, exception: u16) -> i16 {
        match exception {
            exception::NMI => -2,
            exception::HARD_FAULT => -1,
            _ => self.priorities[usize::from(exception) % EXCEPTIONS].into(),
        }
    }

    /// The part of a priority that determines preemption (B1.5.4, PRIGROUP).
    pub(super) fn group_priority(&self, priority: i16) -> i16 {
        if priority < 0 {
            return priority;
        }
        let subpriority = (2_u16 << self.group) - 1;
        priority & !(subpriority as i16)
    }

    /// The priority of the active exceptions: ExecutionPriority() without the masks.
    pub(super) fn active_priority(&self) -> i16 {
        let active = self.active.iter().map(|e| self.group_priority(self.priority(e)));
        active.min().unwrap_or(THREAD_PRIORITY)
    }

    /// The pending and enabled exception to take first: the highest priority, then the lowest number (B1.5.4).
    pub(super) fn first_pending(&self) -> Option<u16> {
        let mut candidates = Set::default();
        for (word, bits) in candidates.0.iter_mut().enumerate() {
            let pending = self.latched.0[word] | self.lines.0[word] & !self.active.0[word];
            *bits = pending & self.enabled.0[word];
        }
        candidates.iter().min_by_key(|exception| self.priority(*exception))
    }

    pub(super) fn is_pending(&self, exception: u16) -> bool {
        self.latched.contains(exception) || self.lines.contains(exception) && !self.active.contains(exception)
    }

    pub(super) fn is_active(&self, exception: u16) -> bool {
        self.active.contains(exception)
    }

    pub(super) fn is_enabled(&self, exception: u16) -> bool {
        self.enabled.contains(exception)
    }

    pub(super) fn active_count(&self) -> usize {
        self.active.iter().count()
    }

    /// The number of a pending interrupt or of another pending exception, enabled or not.
    pub(super) fn is_interrupt_pending(&self) -> bool {
        (exception::INTERRUPT_0..exception::INTERRUPT_0 + self.interrupts).any(|e| self.is_pending(e))
    }

    pub(super) fn take_newly_pending(&mut self) -> bool {
        std::mem::take(&mut self.newly_pending)
    }

    pub(super) fn pend(&mut self, exception: u16) {
        if self.exists(exception) && !self.is_pending(exception) {
            self.newly_pending = true;
        }
        if self.exists(exception) {
            self.latched.insert(exception);
        }
    }

    /// Clears the pending state. An interrupt whose line is high stays pending.
    pub(super) fn unpend(&mut self, exception: u16) {
        self.latched.remove(exception);
    }

    pub(super) fn set_enabled(&mut self, exception: u16, on: bool) {
        if self.exists(exception) {
            self.enabled.set(exception, on);
        }
    }

    pub(super) fn set_active(&mut self, exception: u16, on: bool) {
        self.active.set(exception, on);
    }

    /// An exception is taken: it becomes active and is no longer pending.
    pub(super) fn activate(&mut self, exception: u16) {
        self.latched.remove(exception);
        self.active.insert(exception);
    }

    /// Sets the level of an interrupt line. A rising edge pends the interrupt. Returns true if anything changed.
    pub(super) fn set_line(&mut self, interrupt: u16, high: bool) -> bool {
        let exception = exception::INTERRUPT_0 + interrupt;
        if self.lines.contains(exception) == high || !self.exists(exception) {
            return false;
        }
        if high {
            self.pend(exception);
        }
        self.lines.set(exception, high);
        true
    }

    pub(super) fn set_priority(&mut self, exception: u16, priority: u8) {
        if self.exists(exception) {
            self.priorities[usize::from(exception) % EXCEPTIONS] = priority & self.priority_mask;
        }
    }

    /// The implemented bits of a priority, as in BASEPRI.
    pub(super) fn mask_priority(&self, priority: u32) -> u8 {
        priority as u8 & self.priority_mask
    }

    pub(super) fn set_group(&mut self, group: u8) {
        self.group = group & 7;
    }

    pub(super) fn group(&self) -> u8 {
        self.group
    }

    /// ICTR: number of groups of 32 interrupts, minus one (B3.4.3).
    pub(super) fn ictr(&self) -> u32 {
        u32::from(self.interrupts.div_ceil(32)) - 1
    }

    /// NVIC_ISERn and NVIC_ICERn.
    pub(super) fn enabled_register(&self, register: u16) -> u32 {
        self.enabled.interrupts(register)
    }

    /// NVIC_ISPRn and NVIC_ICPRn.
    pub(super) fn pending_register(&self, register: u16) -> u32 {
        let mut pending = self.latched;
        for (word, bits) in pending.0.iter_mut().enumerate() {
            *bits |= self.lines.0[word] & !self.active.0[word];
        }
        pending.interrupts(register)
    }

    /// NVIC_IABRn.
    pub(super) fn active_register(&self, register: u16) -> u32 {
        self.active.interrupts(register)
    }
}
