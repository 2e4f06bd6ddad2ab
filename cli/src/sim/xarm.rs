//! `armwire sim xarm`: a virtual xArm on TCP ports.

use std::io::{self, ErrorKind};
use std::net::{IpAddr, SocketAddr};
use std::sync::atomic::AtomicBool;

use armwire::xarm::SerialsText;
use armwire_sim::xarm::{BindError, Config, Model, Server, VirtualXArm};
use clap::Args;

use super::line::not_served;
use crate::call::values::whole;
use crate::error::Error;
use crate::output::{print_error, print_line};

/// The report port of an arm.
const REPORT_PORT: u16 = 30002;

/// The arguments of `armwire sim xarm`.
#[derive(Args)]
pub(crate) struct XArmSim {
    /// Address for requests. Port 0 is any free port.
    #[arg(long, value_name = "ADDRESS:PORT", default_value = "127.0.0.1:502", value_parser = parse_address)]
    listen: SocketAddr,
    /// Address for reports, five a second. Without this option: port 30002 at the address for requests.
    #[arg(long, value_name = "ADDRESS:PORT", value_parser = parse_address)]
    report_listen: Option<SocketAddr>,
    /// Send no reports.
    #[arg(long, conflicts_with = "report_listen")]
    no_report: bool,
    /// Allow addresses that other machines can reach. The protocol has no password: any program that reaches the arm can
    /// move, reboot and shut it down.
    #[arg(long)]
    allow_remote: bool,
    /// Number of joints: 5, 6 or 7.
    #[arg(long, value_name = "N", default_value = "6", value_parser = parse_model)]
    axes: Model,
    /// Serial number of the arm, such as XI120204201B02. The vendor's SDK requires
    /// digits as characters 3 to 6.
    #[arg(long, value_name = "TEXT")]
    serial: Option<String>,
    /// Serial number of its control box.
    #[arg(long, value_name = "TEXT")]
    box_serial: Option<String>,
    /// Initial error, by its number in the vendor's list.
    #[arg(long, value_name = "CODE", default_value_t = 0, value_parser = whole::<u8>(0..=u8::MAX.into()))]
    error: u8,
    /// Initial warning, by its number in the vendor's list.
    #[arg(long, value_name = "CODE", default_value_t = 0, value_parser = whole::<u8>(0..=u8::MAX.into()))]
    warning: u8,
}

fn parse_address(text: &str) -> Result<SocketAddr, String> {
    text.parse()
        .map_err(|_| format!("'{text}' is not an address and a port, such as 127.0.0.1:15020 or [::1]:15020"))
}

fn parse_model(text: &str) -> Result<Model, String> {
    match text {
        "5" => Ok(Model::XArm5),
        "6" => Ok(Model::XArm6),
        "7" => Ok(Model::XArm7),
        _ => Err("expected 5, 6 or 7".to_owned()),
    }
}

impl XArmSim {
    pub(super) fn run(&self, stop: &AtomicBool) -> Result<(), Error> {
        let report = (!self.no_report).then(|| {
            let beside = SocketAddr::new(self.listen.ip(), REPORT_PORT);
            self.report_listen.unwrap_or(beside)
        });
        for address in [Some(self.listen), report].into_iter().flatten() {
            if !self.allow_remote && !is_loopback(address.ip()) {
                return Err(Error::Usage(format!(
                    "other machines could reach {address} and move the arm: use 127.0.0.1, \
                     or add --allow-remote"
                )));
            }
        }
        if report.is_some_and(|report| overlap(self.listen, report)) {
            return Err(Error::Usage(format!(
                "requests and reports are both to be at port {}: choose another for one (--listen, --report-listen), or \
                 none for reports (--no-report)",
                self.listen.port()
            )));
        }
        let config = self.config()?;
        let mut arm = VirtualXArm::new(config);
        arm.set_error(self.error);
        arm.set_warning(self.warning);

        let server = Server::bind(self.listen, report).map_err(|error| {
            let is_report = Some(error.address) == report;
            not_served(advice(&error, is_report))
        })?;
        let axes = config.model.joints();
        let reports = match server.report_address() {
            Some(address) => format!("its reports at {address}"),
            None => "without reports".to_owned(),
        };
        print_line(format_args!(
            "xArm {axes} {} is at {}, {reports}; Ctrl-C ends it.",
            SerialsText(&config.serials),
            server.control_address()
        ))?;

        let mut notice = |notice| print_error(&notice);
        let served = server.serve(&mut arm, stop, &mut notice).map_err(not_served)?;
        print_line(format_args!(
            "{} connections, {} broken; {} requests, {} unknown frames; {} reports, {} not read in time.",
            served.clients, served.broken, served.requests, served.unknown, served.reports, served.lost
        ))
    }

    fn config(&self) -> Result<Config, Error> {
        let config = Config::new(self.axes);
        let usual = SerialsText(&config.serials);
        let arm = self.serial.as_deref().or(usual.arm());
        let control_box = self.box_serial.as_deref().or(usual.control_box());
        let serials = SerialsText::encode(arm.unwrap_or_default(), control_box.unwrap_or_default());
        let serials = serials.map_err(|error| Error::Usage(error.to_string()))?;
        Ok(Config { serials, ..config })
    }
}

/// Returns true for addresses that cannot both be listened on.
fn overlap(a: SocketAddr, b: SocketAddr) -> bool {
    let is_one_ip = a.ip() == b.ip() || a.ip().is_unspecified() || b.ip().is_unspecified();
    a.port() == b.port() && a.port() != 0 && is_one_ip
}

fn is_loopback(ip: IpAddr) -> bool {
    ip.to_canonical().is_loopback()
}

/// The hint for a port that cannot be bound, that of requests or of reports, with the option that chooses another.
fn advice(problem: &BindError, is_report: bool) -> io::Error {
    let BindError { address, error } = problem;
    let port = address.port();
    let (option, or_none) = match is_report {
        true => ("--report-listen", ", or --no-report"),
        false => ("--listen", ""),
    };
    let choice = |port| format!("{option} {}{or_none}", SocketAddr::new(address.ip(), port));
    let text = match error.kind() {
        ErrorKind::PermissionDenied => format!(
            "{address}: permission denied, as ports below 1024 are the administrator's: choose another \
             ({}), or allow every program this one \
             ('sudo sysctl net.ipv4.ip_unprivileged_port_start={port}')",
            choice(15020)
        ),
        ErrorKind::AddrInUse => format!(
            "{address}: in use by another program: close that one, or choose any free port ({})",
            choice(0)
        ),
        ErrorKind::AddrNotAvailable => format!("{address}: this machine has no such address"),
        _ => format!("{address}: {error}"),
    };
    io::Error::new(error.kind(), text)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_this_machine_is_loopback() {
        for ours in ["127.0.0.1", "127.1.2.3", "::1", "::ffff:127.0.0.1"] {
            assert!(is_loopback(ours.parse().unwrap()), "{ours}");
        }
        for others in ["0.0.0.0", "::", "192.168.1.1", "::ffff:10.0.0.1"] {
            assert!(!is_loopback(others.parse().unwrap()), "{others}");
        }
    }

    #[test]
    fn bind_errors_come_with_advice() {
        let advice_of = |address: &str, kind: ErrorKind, is_report| {
            let (address, error) = (address.parse().unwrap(), kind.into());
            advice(&BindError { address, error }, is_report).to_string()
        };
        let advice = |address, kind| advice_of(address, kind, false);
        assert!(advice("127.0.0.1:502", ErrorKind::PermissionDenied).contains("(--listen 127.0.0.1:15020)"));
        assert!(advice("[::1]:502", ErrorKind::PermissionDenied).contains("(--listen [::1]:15020)"));
        assert!(advice("127.0.0.1:502", ErrorKind::AddrInUse).ends_with("(--listen 127.0.0.1:0)"));
        let report = advice_of("[::1]:30002", ErrorKind::AddrInUse, true);
        assert!(
            report.ends_with("(--report-listen [::1]:0, or --no-report)"),
            "{report}"
        );
    }
}
