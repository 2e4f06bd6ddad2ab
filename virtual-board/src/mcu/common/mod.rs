//! The common flow of a microcontroller, and the peripherals common to the STM32F405 and the STM32G431.

pub(crate) mod capture;
pub(crate) mod dbgmcu;
pub(crate) mod dma;
pub(crate) mod flash;
pub(crate) mod gpio;
pub(crate) mod iwdg;
pub(crate) mod mcu;
pub(crate) mod rcc;
pub(crate) mod shifter;
pub(crate) mod syscfg;
pub(crate) mod system_memory;
pub(crate) mod tim;
pub(crate) mod usart;
