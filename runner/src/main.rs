//! The command line of weir.

mod cli;

use std::io::IsTerminal;

use clap::Parser;
use tracing_subscriber::{
    filter::{LevelFilter, Targets},
    layer::SubscriberExt,
    util::SubscriberInitExt,
};
use weir::exit::Exit;

fn main() -> Exit {
    let arguments = cli::Arguments::parse();
    let wanted = std::env::var("WEIR_LOG").ok().and_then(|text| text.parse().ok());
    let levels = wanted.unwrap_or_else(|| {
        Targets::new().with_default(LevelFilter::ERROR).with_target(env!("CARGO_PKG_NAME"), LevelFilter::INFO)
    });
    let messages = tracing_subscriber::fmt::layer()
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .with_target(false);
    tracing_subscriber::registry().with(messages).with(levels).init();
    // The message of a panic is on stderr by then.
    match std::panic::catch_unwind(|| cli::run(&arguments)) {
        Ok(Ok(exit)) => exit,
        Ok(Err(error)) => {
            eprintln!("weir: {error:#}");
            Exit::of(error.as_ref())
        }
        Err(_) => Exit::Internal,
    }
}
