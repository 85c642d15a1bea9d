//! The command line of weir.

mod cli;

use std::io::IsTerminal;

use clap::Parser;
use weir::exit::Exit;

fn main() -> Exit {
    let arguments = cli::Arguments::parse();
    let filter = tracing_subscriber::EnvFilter::try_from_env("WEIR_LOG")
        .unwrap_or_else(|_| tracing_subscriber::EnvFilter::new("weir=info,wgpu_hal=error,wgpu_core=error,error"));
    tracing_subscriber::fmt()
        .with_env_filter(filter)
        .with_writer(std::io::stderr)
        .with_ansi(std::io::stderr().is_terminal())
        .without_time()
        .with_target(false)
        .init();
    match cli::run(&arguments) {
        Ok(exit) => exit,
        Err(error) => {
            eprintln!("weir: {error:#}");
            Exit::of(error.as_ref())
        }
    }
}
