//! What a run has found: as JSON, which `--compare` reads again, and as CSV.

use serde::{Deserialize, Serialize};

use super::statistics::Quantity;

/// Changes when a field changes its meaning.
pub const SCHEMA: &str = "weir-bench-1";

/// A run.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Results {
    /// [`SCHEMA`].
    pub schema: String,
    /// Where.
    pub machine: Machine,
    /// How.
    pub options: RunOptions,
    /// By scene.
    pub scenes: Vec<SceneResults>,
    /// Cost against the number of lights.
    pub lights: Vec<LightCost>,
    /// One knob at a time.
    pub ablation: Vec<Ablation>,
    /// What was left out, and why.
    pub left_out: Vec<String>,
}

/// Where it ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct Machine {
    /// Operating system and architecture.
    pub system: String,
    /// Name of the processor.
    pub cpu: String,
    /// Threads that passes ran on.
    pub threads: usize,
    /// `CPU`, or the GPU's name and driver.
    pub adapter: String,
    /// Version of weir.
    pub weir: String,
}

/// How it ran.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct RunOptions {
    /// Pixels in a row.
    pub width: u32,
    /// Rows.
    pub height: u32,
    /// Times at which stills are judged, in seconds.
    pub times_s: Vec<f64>,
    /// Seeds of each method.
    pub seeds: u32,
    /// Frames of each chain.
    pub chain_frames: u32,
}

/// A scene.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct SceneResults {
    /// Its name.
    pub name: String,
    /// Triangles over all instances.
    pub triangles: u64,
    /// Emissive ones among them.
    pub lights: u64,
    /// What methods are judged by.
    pub reference: ReferenceFacts,
    /// By method, independent frames first.
    pub methods: Vec<MethodResults>,
    /// Most memory that the process had at the end of this scene, in bytes; 0 where the system does not say.
    pub peak_bytes: u64,
}

/// The judge.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub struct ReferenceFacts {
    /// How it was made.
    pub integrator: String,
    /// Samples of each pixel.
    pub samples: u32,
    /// Its own relMSE, from its variance; taken off that of others.
    pub rel_mse: f64,
    /// Standard error of its mean, as a share of it.
    pub mean_error: f64,
    /// Name of its file. Not its folder, which is the machine's own affair.
    pub file: String,
}

/// A method on a scene.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct MethodResults {
    /// Its name.
    pub name: String,
    /// Its knobs.
    pub knobs: Vec<String>,
    /// Whether frames reuse each other.
    pub is_chain: bool,
    /// Milliseconds of a frame without the first: building and uploading included. Samples are medians of parts of the
    /// run.
    pub frame_ms: Quantity,
    /// The same over the time that a fixed piece of work took in between: what is left where the machine is shared.
    pub frame_yardsticks: Quantity,
    /// Milliseconds of the first frame.
    pub first_frame_ms: f64,
    /// Median milliseconds of each pass, and of building and uploading.
    pub passes_ms: Vec<(String, f64)>,
    /// Camera rays a second in `primary`, in millions.
    pub camera_mrays: f64,
    /// Error at each time, or of the last frames of a chain as the only point.
    pub points: Vec<Point>,
    /// Variance of one frame over x² + 0.01 m², mean over pixels; of a chain its relMSE.
    pub relative_variance: Quantity,
    /// Frames of [`super::methods::UNIT`] that one frame is worth.
    pub n_eff: f64,
    /// Candidates that had a say in one frame, counted again where they are shared.
    pub nominal: u64,
    /// 1 / (relMSE x seconds), at the last point.
    pub efficiency: f64,
    /// Difference of the means of picture and reference, as a share of the reference's. The interval knows of the noise of
    /// both.
    pub bias: Quantity,
    /// Half the mean square of the difference of successive frames, over r² + 0.01 m²: the relMSE if frames were
    /// independent, less if errors stay. Chains only.
    pub flicker: Option<f64>,
    /// relMSE of each frame after a cut. Chains only.
    pub recovery: Vec<f64>,
    /// Buffers of the frame, in bytes.
    pub frame_bytes: u64,
}

/// Error at a time.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Point {
    /// Time spent on frames, in seconds, median over seeds.
    pub time_s: f64,
    /// Frames, median over seeds.
    pub frames: f64,
    /// relMSE less that of the reference.
    pub rel_mse: Quantity,
    /// 0.1 is 10 %.
    pub mape: Quantity,
    /// 0.1 is 10 %.
    pub smape: Quantity,
    /// Of the tone-mapped picture; absent unless built in.
    pub flip: Option<Quantity>,
}

/// A frame of `balanced` with so many lights.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct LightCost {
    /// Emissive triangles.
    pub lights: u64,
    /// Of a still.
    pub still_ms: Quantity,
    /// In real time, moving the scene included.
    pub chain_ms: Quantity,
}

/// A knob at one value, in the real-time chain.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
pub struct Ablation {
    /// Scene.
    pub scene: String,
    /// Knob.
    pub knob: String,
    /// Value.
    pub value: String,
    /// Whether it is the default.
    pub is_default: bool,
    /// A frame.
    pub frame_ms: Quantity,
    /// Of one frame at the end of the chain.
    pub rel_mse: Quantity,
}

impl Results {
    /// As CSV: a row for each scene, method and time.
    ///
    /// # Errors
    /// None that a buffer in memory has.
    pub fn to_csv(&self) -> Result<Vec<u8>, csv::Error> {
        let mut csv = csv::Writer::from_writer(Vec::new());
        csv.write_record([
            "scene",
            "method",
            "kind",
            "time_s",
            "frames",
            "rel_mse",
            "rel_mse_low",
            "rel_mse_high",
            "mape",
            "smape",
            "flip",
            "frame_ms",
            "frame_ms_low",
            "frame_ms_high",
            "first_frame_ms",
            "camera_mrays_per_s",
            "relative_variance_of_frame",
            "n_eff",
            "nominal",
            "efficiency",
            "bias",
            "bias_low",
            "bias_high",
            "flicker",
            "frame_bytes",
        ])?;
        for scene in &self.scenes {
            for m in &scene.methods {
                for p in &m.points {
                    let optional = |v: Option<f64>| v.map_or_else(String::new, |v| v.to_string());
                    let numbers = [
                        p.time_s,
                        p.frames,
                        p.rel_mse.value,
                        p.rel_mse.low,
                        p.rel_mse.high,
                        p.mape.value,
                        p.smape.value,
                    ];
                    let rest = [
                        m.frame_ms.value,
                        m.frame_ms.low,
                        m.frame_ms.high,
                        m.first_frame_ms,
                        m.camera_mrays,
                        m.relative_variance.value,
                        m.n_eff,
                        m.nominal as f64,
                        m.efficiency,
                        m.bias.value,
                        m.bias.low,
                        m.bias.high,
                    ];
                    let mut row = vec![scene.name.clone(), m.name.clone()];
                    row.push(String::from(if m.is_chain { "chain" } else { "independent" }));
                    row.extend(numbers.iter().map(f64::to_string));
                    row.push(optional(p.flip.as_ref().map(|q| q.value)));
                    row.extend(rest.iter().map(f64::to_string));
                    row.push(optional(m.flicker));
                    row.push(m.frame_bytes.to_string());
                    csv.write_record(row)?;
                }
            }
        }
        csv.into_inner().map_err(|error| error.into_error().into())
    }
}
