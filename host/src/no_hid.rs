//! A build without HID devices: the feature `hid` is off.

use crate::error::Error;
use crate::hid_selector::Selector;
use crate::link::Line;

/// No names.
pub const fn alpha1_names() -> Vec<String> {
    Vec::new()
}

/// Opens no device.
///
/// # Errors
///
/// Always, with the programs that do open it.
pub fn open(selector: &Selector) -> Result<Box<dyn Line>, Error> {
    Err(Error::at(
        &format!("hid:{selector}"),
        "HID devices are not supported by this build: use the `armwire` command of `cargo install --path cli`, or connect \
         the robot as a serial port",
    ))
}

#[cfg(test)]
mod tests {
    use crate::port::Port;

    #[test]
    fn hid_port_is_refused_with_the_way_out() {
        let connection = "hid:".parse::<Port>().unwrap().open(Options::default()).unwrap();
        let error = connection.alpha1().map(drop).unwrap_err().to_string();
        assert!(
            error.starts_with("hid:: HID devices are not supported by this build: use the `armwire` command"),
            "{error}"
        );
    }
}
