//! `armwire config`: an adapter's configuration.

use armwire_bridge::config::Config;
use armwire_bridge::store::Saved;
use armwire_host::Adapter;
use armwire_host::settings::{KEYS, Setting, object, show};
use clap::{Args, Subcommand};

use crate::adapter::{self, AdapterPort};
use crate::error::Error;
use crate::output::{print, print_error, print_json};

/// The arguments of `armwire config`.
#[derive(Args)]
pub(crate) struct Configure {
    #[command(flatten)]
    adapter: AdapterPort,
    /// Print the configuration as one JSON object.
    #[arg(long, global = true)]
    json: bool,
    #[command(subcommand)]
    action: Option<Action>,
}

/// The action. Each prints the configuration in force afterwards.
#[derive(Clone, Subcommand)]
enum Action {
    /// Print the configuration in force, as `set` accepts it (default).
    Show,
    /// Change settings. Unless saved, they last until the next start of the adapter.
    #[command(after_help = help())]
    Set {
        /// Settings, such as poll=200 can.node=3.
        #[arg(required = true, value_name = "KEY=VALUE")]
        settings: Vec<Setting>,
        /// Save the whole configuration for later starts.
        #[arg(long)]
        save: bool,
    },
    /// Save the configuration in force for later starts.
    Save,
    /// Erase the saved configuration and restore the factory defaults.
    Reset,
}

/// Refuses settings of which two have the same key.
fn check_distinct(settings: &[Setting]) -> Result<(), Error> {
    for (i, Setting { key, value, .. }) in settings.iter().enumerate() {
        if let Some(earlier) = settings[..i].iter().find(|earlier| earlier.key.name == key.name) {
            let (name, first) = (key.name, &earlier.value);
            let text = format!("{name} is given twice: {name}={first} and {name}={value}");
            return Err(Error::Usage(text));
        }
    }
    Ok(())
}

/// The list of settings, in lines of 80 columns.
fn help() -> String {
    let lines = KEYS
        .iter()
        .map(|key| format!("  {}\n      {}:\n      {}\n", key.name, key.help, key.values));
    lines.fold("Settings:\n".to_owned(), |text, line| text + &line)
}

impl Configure {
    pub(crate) fn run(&self) -> Result<(), Error> {
        if let Some(Action::Set { settings, .. }) = &self.action {
            check_distinct(settings)?;
        }
        let mut control = self.adapter.open()?;
        match self.action.as_ref().unwrap_or(&Action::Show) {
            Action::Show => {}
            Action::Set { settings, save } => {
                let config = control.change_config(settings)?;
                control = self.follow(control, &config)?;
                if *save {
                    report_overwritten(&mut control)?;
                    control.save_config()?;
                }
            }
            Action::Save => {
                report_overwritten(&mut control)?;
                control.save_config()?;
            }
            Action::Reset => {
                report_overwritten(&mut control)?;
                control.reset_config()?;
                control = self.follow(control, &Config::default())?;
            }
        }
        adapter::report_reservation(&mut control)?;
        adapter::report_recovery(&mut control)?;
        let (identity, config) = (control.identify()?, control.config()?);
        if self.json {
            return print_json(&object(&config, &identity));
        }
        print(&show(&config, &identity))
    }

    /// The adapter where it is on the CAN bus now that it is so.
    fn follow(&self, control: Adapter, config: &Config) -> Result<Adapter, Error> {
        let moved = self.adapter.moved(&config.can);
        if moved == self.adapter {
            return Ok(control);
        }
        // The port is opened once.
        drop(control);
        moved.open()
    }
}

/// Names on standard error what a save overwrites, if the adapter is in recovery: its owner has not seen it.
fn report_overwritten(control: &mut Adapter) -> Result<(), Error> {
    if control.is_in_recovery()? {
        let saved = match control.saved()? {
            Saved::Config(config) => format!(
                "saved settings are overwritten: {}",
                show(&config, &control.identify()?).trim().replace('\n', " ")
            ),
            Saved::Nothing => "no settings were saved".to_owned(),
            Saved::Unreadable => "saved settings that are unreadable are overwritten".to_owned(),
        };
        print_error(&format_args!("{}: {saved}", control.name()));
    }
    Ok(())
}
