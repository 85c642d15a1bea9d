//! From a row of the pass table to entry points, kernels and bindings.
//!
//! The row
//!
//! ```text
//! pixel shade[SPECULAR](scene, surfaces: [Surface]) -> (color: [Vec4]) = shade::shade;
//! ```
//!
//! becomes, for each combination of its features (here `o`, off, and `x`, on),
//!
//! ```text
//! #[spirv(compute(threads(8, 8)))]
//! pub fn x(
//!     #[spirv(global_invocation_id)] id: UVec3,
//!     #[spirv(uniform, descriptor_set = 0, binding = 0)] frames: &FramePair,
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] triangles: &[f32],   // `scene` is three buffers
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] records: &[u32],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] texels: &[u32],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] surfaces: &[Surface],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] color: &mut [Vec4],
//! ) {
//!     let frame = &frames.now;
//!     if id.x < frame.width && id.y < frame.height {
//!         let value = shade::shade::<true>(id.truncate(), frame, &Scene { triangles, records, texels }, surfaces);
//!         store(color, frame.index_of(id.truncate()), value);
//!     }
//! }
//! ```
//!
//! in a module `entry::shade`, a host kernel with the same call in a module `kernel::shade`, and a row of `PASSES`.
//! A row that starts with `reservoir` instead of `pixel` runs once for each reservoir of each pixel: the function gets its
//! number after the pixel, and outputs have an element for each; `candidate` does so for each candidate of each. One that starts with `record` runs once for each record of
//! lights drawn ahead: instead of the pixel the function gets column and row of the record. The input `prev_frame` stands
//! for the frame before, in the same uniform. The input `rays` is what finds intersections: the nodes `bvh`, or, with the
//! feature `ray-query`, which leaves out all rows but those that trace rays, acceleration structures of the driver for the
//! two blocks of instances. Binding numbers are consumed from a list, so they are dense by construction;
//! the same types are checked on both sides by the call.

/// Declares the passes; see the module's documentation.
#[macro_export]
macro_rules! passes {
    // All rows.
    ($($extent:ident $name:ident [$($feature:ident)*] ($($input:tt)*) -> ($($output:ident : [$element:ty]),+) = $file:ident :: $function:ident ;)*) => {
        /// GPU entry points: one module a pass, one function a combination of its features.
        #[cfg(not(all(feature = "ray-query", target_arch = "spirv")))]
        pub mod entry {
            $(
                #[doc = concat!("Entry points of pass `", stringify!($name), "`.")]
                pub mod $name {
                    #[allow(unused_imports)]
                    use $crate::wiring::prelude::*;
                    $crate::passes!{ @variants entry ($extent $file $function) [$($feature)*] [$($input)*] [$($output : [$element]),+] }
                }
            )*
        }

        /// GPU entry points of the passes that trace rays, by ray queries.
        #[cfg(all(feature = "ray-query", target_arch = "spirv"))]
        pub mod entry {
            $(
                #[doc = concat!("Entry points of pass `", stringify!($name), "`.")]
                pub mod $name {
                    #[allow(unused_imports)]
                    use $crate::wiring::prelude::*;
                    $crate::passes!{ @variants query ($extent $file $function) [$($feature)*] [$($input)*] [$($output : [$element]),+] }
                }
            )*
        }

        /// Host kernels: one module a pass, one function a combination of its features.
        #[cfg(not(target_arch = "spirv"))]
        pub mod kernel {
            $(
                #[doc = concat!("Kernels of pass `", stringify!($name), "`.")]
                pub mod $name {
                    #[allow(unused_imports)]
                    use $crate::wiring::prelude::*;
                    $crate::passes!{ @variants kernel ($extent $file $function) [$($feature)*] [$($input)*] [$($output : [$element]),+] }
                }
            )*
        }

        /// Every pass, in the order of the table.
        #[cfg(not(target_arch = "spirv"))]
        pub const PASSES: &[$crate::wiring::Pass] = {
            #[allow(unused_imports)]
            use $crate::wiring::prelude::*;
            &[$(
                $crate::wiring::Pass {
                    name: stringify!($name),
                    extent: $crate::passes!(@extent $extent),
                    features: &[$($crate::wiring::Feature::$feature),*],
                    variants: $crate::passes!(@table $name [$($feature)*]),
                    bindings: $crate::passes!(@bindings [] [$($input)*] [$($output : [$element]),+]),
                },
            )*]
        };
    };

    // Feature combinations: `x` is on, `o` is off, in the order of the row.
    (@variants $kind:ident $f:tt [] $i:tt $o:tt) => {
        $crate::passes!{ @$kind main $f [] $i $o }
    };
    (@variants $kind:ident $f:tt [$a:ident $b:ident] $i:tt $o:tt) => {
        $crate::passes!{ @$kind oo $f [false, false] $i $o }
        $crate::passes!{ @$kind xo $f [true, false] $i $o }
        $crate::passes!{ @$kind ox $f [false, true] $i $o }
        $crate::passes!{ @$kind xx $f [true, true] $i $o }
    };
    (@variants $kind:ident $f:tt [$a:ident $b:ident $c:ident] $i:tt $o:tt) => {
        $crate::passes!{ @$kind ooo $f [false, false, false] $i $o }
        $crate::passes!{ @$kind xoo $f [true, false, false] $i $o }
        $crate::passes!{ @$kind oxo $f [false, true, false] $i $o }
        $crate::passes!{ @$kind xxo $f [true, true, false] $i $o }
        $crate::passes!{ @$kind oox $f [false, false, true] $i $o }
        $crate::passes!{ @$kind xox $f [true, false, true] $i $o }
        $crate::passes!{ @$kind oxx $f [false, true, true] $i $o }
        $crate::passes!{ @$kind xxx $f [true, true, true] $i $o }
    };
    (@variants $kind:ident $f:tt [$a:ident $b:ident $c:ident $d:ident] $i:tt $o:tt) => {
        $crate::passes!{ @$kind oooo $f [false, false, false, false] $i $o }
        $crate::passes!{ @$kind xooo $f [true, false, false, false] $i $o }
        $crate::passes!{ @$kind oxoo $f [false, true, false, false] $i $o }
        $crate::passes!{ @$kind xxoo $f [true, true, false, false] $i $o }
        $crate::passes!{ @$kind ooxo $f [false, false, true, false] $i $o }
        $crate::passes!{ @$kind xoxo $f [true, false, true, false] $i $o }
        $crate::passes!{ @$kind oxxo $f [false, true, true, false] $i $o }
        $crate::passes!{ @$kind xxxo $f [true, true, true, false] $i $o }
        $crate::passes!{ @$kind ooox $f [false, false, false, true] $i $o }
        $crate::passes!{ @$kind xoox $f [true, false, false, true] $i $o }
        $crate::passes!{ @$kind oxox $f [false, true, false, true] $i $o }
        $crate::passes!{ @$kind xxox $f [true, true, false, true] $i $o }
        $crate::passes!{ @$kind ooxx $f [false, false, true, true] $i $o }
        $crate::passes!{ @$kind xoxx $f [true, false, true, true] $i $o }
        $crate::passes!{ @$kind oxxx $f [false, true, true, true] $i $o }
        $crate::passes!{ @$kind xxxx $f [true, true, true, true] $i $o }
    };
    (@table $name:ident []) => { &[$crate::passes!(@row $name main)] };
    (@table $name:ident [$a:ident $b:ident]) => {
        &[
            $crate::passes!(@row $name oo), $crate::passes!(@row $name xo),
            $crate::passes!(@row $name ox), $crate::passes!(@row $name xx),
        ]
    };
    (@table $name:ident [$a:ident $b:ident $c:ident]) => {
        &[
            $crate::passes!(@row $name ooo), $crate::passes!(@row $name xoo),
            $crate::passes!(@row $name oxo), $crate::passes!(@row $name xxo),
            $crate::passes!(@row $name oox), $crate::passes!(@row $name xox),
            $crate::passes!(@row $name oxx), $crate::passes!(@row $name xxx),
        ]
    };
    (@table $name:ident [$a:ident $b:ident $c:ident $d:ident]) => {
        &[
            $crate::passes!(@row $name oooo), $crate::passes!(@row $name xooo),
            $crate::passes!(@row $name oxoo), $crate::passes!(@row $name xxoo),
            $crate::passes!(@row $name ooxo), $crate::passes!(@row $name xoxo),
            $crate::passes!(@row $name oxxo), $crate::passes!(@row $name xxxo),
            $crate::passes!(@row $name ooox), $crate::passes!(@row $name xoox),
            $crate::passes!(@row $name oxox), $crate::passes!(@row $name xxox),
            $crate::passes!(@row $name ooxx), $crate::passes!(@row $name xoxx),
            $crate::passes!(@row $name oxxx), $crate::passes!(@row $name xxxx),
        ]
    };
    (@row $name:ident $variant:ident) => {
        $crate::wiring::Variant {
            entry_point: concat!("entry::", stringify!($name), "::", stringify!($variant)),
            run: kernel::$name::$variant,
        }
    };

    (@extent pixel) => { $crate::wiring::Extent::Pixels };
    (@extent reservoir) => { $crate::wiring::Extent::Reservoirs };
    (@extent candidate) => { $crate::wiring::Extent::Candidates };
    (@extent record) => { $crate::wiring::Extent::Records };

    // Columns and rows that a pass runs over.
    (@columns record $frame:ident) => { $frame.presampled_columns };
    (@columns $extent:ident $frame:ident) => { $frame.width };
    (@rows record $frame:ident) => { $frame.presampled_rows };
    (@rows $extent:ident $frame:ident) => { $frame.height };

    // The call of a pass, and the index of its element.
    (@call reservoir $function:path, $px:ident, $number:expr, $frame:ident, [$($argument:tt)*]) => {
        $function($px, $number, $frame, $($argument),*)
    };
    (@call candidate $function:path, $px:ident, $number:expr, $frame:ident, [$($argument:tt)*]) => {
        $function($px, $number, $frame, $($argument),*)
    };
    (@call $extent:ident $function:path, $px:ident, $number:expr, $frame:ident, [$($argument:tt)*]) => {{
        let _ = $number;
        $function($px, $frame, $($argument),*)
    }};
    (@index pixel $px:ident, $number:expr, $frame:ident) => { $frame.index_of($px) };
    (@index reservoir $px:ident, $number:expr, $frame:ident) => { $frame.index_of_reservoir($px, $number) };
    (@index candidate $px:ident, $number:expr, $frame:ident) => { $frame.index_of_candidate($px, $number) };
    (@index record $px:ident, $number:expr, $frame:ident) => { $frame.index_of_record($px) };

    // The list of bindings, `scene` expanded.
    (@bindings $done:tt [prev_frame, $($rest:tt)*] $o:tt) => {
        $crate::passes!(@bindings $done [$($rest)*] $o)
    };
    (@bindings [$($done:tt)*] [rays $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!(@bindings [$($done)* (bvh UVec4)] [$($($rest)*)?] $o)
    };
    (@bindings [$($done:tt)*] [scene $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!(@bindings [$($done)* (triangles f32) (records u32) (texels u32)] [$($($rest)*)?] $o)
    };
    (@bindings [$($done:tt)*] [$name:ident : [$element:ty] $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!(@bindings [$($done)* ($name $element)] [$($($rest)*)?] $o)
    };
    (@bindings [$(($input:ident $type:ty))*] [] [$($output:ident : [$element:ty]),+]) => {
        &[
            $($crate::wiring::Binding::read::<$type>(stringify!($input)),)*
            $($crate::wiring::Binding::write::<$element>(stringify!($output)),)+
        ]
    };

    // GPU entry point: number the bindings and collect the arguments, then write the function.
    (@query $variant:ident $f:tt $g:tt [prev_frame, scene, rays $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @entry $variant $f $g [prev_frame, scene, queries $(, $($rest)*)?] $o }
    };
    (@query $variant:ident $f:tt $g:tt [scene, rays $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @entry $variant $f $g [scene, queries $(, $($rest)*)?] $o }
    };
    (@query $variant:ident $f:tt $g:tt $i:tt $o:tt) => {};
    (@entry $variant:ident $f:tt [$($flag:literal),*] [$($i:tt)*] $o:tt) => {
        $crate::passes!{ @number $variant $f [$($flag),*] (frames frame) [1 2 3 4 5 6 7 8 9 10 11 12] [] [] [$($i)*] $o }
    };
    (@number $v:ident $f:tt $g:tt ($frames:ident $frame:ident) $n:tt $p:tt [$($a:tt)*] [prev_frame, $($rest:tt)*] $o:tt) => {
        $crate::passes!{ @number $v $f $g ($frames $frame) $n $p [$($a)* (&$frames.prev)] [$($rest)*] $o }
    };
    (@number $v:ident $f:tt $g:tt $frame:tt [$n0:literal $n1:literal $n2:literal $($n:literal)*] [$($p:tt)*] [$($a:tt)*] [scene $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @number $v $f $g $frame [$($n)*]
            [$($p)* ($n0 triangles [f32], storage_buffer) ($n1 records [u32], storage_buffer) ($n2 texels [u32], storage_buffer)]
            [$($a)* (&Scene { triangles, records, texels })] [$($($rest)*)?] $o }
    };
    (@number $v:ident $f:tt $g:tt $frame:tt [$n0:literal $($n:literal)*] [$($p:tt)*] [$($a:tt)*] [rays $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @number $v $f $g $frame [$($n)*] [$($p)* ($n0 bvh [UVec4], storage_buffer)] [$($a)* (bvh)] [$($($rest)*)?] $o }
    };
    (@number $v:ident $f:tt $g:tt $frame:tt [$n0:literal $n1:literal $($n:literal)*] [$($p:tt)*] [$($a:tt)*] [queries $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @number $v $f $g $frame [$($n)*]
            [$($p)* ($n0 even AccelerationStructure) ($n1 odd AccelerationStructure)]
            [$($a)* (Queries { even, odd })] [$($($rest)*)?] $o }
    };
    (@number $v:ident $f:tt $g:tt $frame:tt [$n0:literal $($n:literal)*] [$($p:tt)*] [$($a:tt)*] [$name:ident : [$element:ty] $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @number $v $f $g $frame [$($n)*] [$($p)* ($n0 $name [$element], storage_buffer)] [$($a)* ($name)] [$($($rest)*)?] $o }
    };
    (@number $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident) [$n0:literal $($n:literal)*]
        [$(($number:literal $param:ident $type:ty $(, $class:ident)?))*] [$($argument:tt)*] [] [$output:ident : [$element:ty]]) => {
        #[spirv(compute(threads(8, 8)))]
        #[doc = "Entry point."]
        pub fn $v(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(uniform, descriptor_set = 0, binding = 0)] $frames: &FramePair,
            $(#[spirv($($class,)? descriptor_set = 0, binding = $number)] $param: &$type,)*
            #[spirv(storage_buffer, descriptor_set = 0, binding = $n0)] $output: &mut [$element],
        ) {
            let px = id.truncate();
            let $frame = &$frames.now;
            if px.x < $crate::passes!(@columns $extent $frame) && px.y < $crate::passes!(@rows $extent $frame) {
                let value = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, id.z, $frame, [$($argument)*]);
                store($output, $crate::passes!(@index $extent px, id.z, $frame), value);
            }
        }
    };
    (@number $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident) [$n0:literal $n1:literal $($n:literal)*]
        [$(($number:literal $param:ident $type:ty $(, $class:ident)?))*] [$($argument:tt)*] []
        [$first:ident : [$first_element:ty], $second:ident : [$second_element:ty]]) => {
        #[spirv(compute(threads(8, 8)))]
        #[doc = "Entry point."]
        pub fn $v(
            #[spirv(global_invocation_id)] id: UVec3,
            #[spirv(uniform, descriptor_set = 0, binding = 0)] $frames: &FramePair,
            $(#[spirv($($class,)? descriptor_set = 0, binding = $number)] $param: &$type,)*
            #[spirv(storage_buffer, descriptor_set = 0, binding = $n0)] $first: &mut [$first_element],
            #[spirv(storage_buffer, descriptor_set = 0, binding = $n1)] $second: &mut [$second_element],
        ) {
            let px = id.truncate();
            let $frame = &$frames.now;
            if px.x < $crate::passes!(@columns $extent $frame) && px.y < $crate::passes!(@rows $extent $frame) {
                let value = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, id.z, $frame, [$($argument)*]);
                let index = $crate::passes!(@index $extent px, id.z, $frame);
                store($first, index, value.0);
                store($second, index, value.1);
            }
        }
    };

    // Host kernel: read the same arguments in the same order, then walk the tiles of a band of rows.
    (@kernel $variant:ident $f:tt [$($flag:literal),*] [$($i:tt)*] $o:tt) => {
        $crate::passes!{ @collect $variant $f [$($flag),*] (frames frame) [] [] [$($i)*] $o }
    };
    (@collect $v:ident $f:tt $g:tt ($frames:ident $frame:ident) $p:tt [$($a:tt)*] [prev_frame, $($rest:tt)*] $o:tt) => {
        $crate::passes!{ @collect $v $f $g ($frames $frame) $p [$($a)* (&$frames.prev)] [$($rest)*] $o }
    };
    (@collect $v:ident $f:tt $g:tt $frame:tt [$($p:tt)*] [$($a:tt)*] [rays $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @collect $v $f $g $frame [$($p)* (bvh UVec4)] [$($a)* (bvh)] [$($($rest)*)?] $o }
    };
    (@collect $v:ident $f:tt $g:tt $frame:tt [$($p:tt)*] [$($a:tt)*] [scene $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @collect $v $f $g $frame [$($p)* (triangles f32) (records u32) (texels u32)]
            [$($a)* (&Scene { triangles, records, texels })] [$($($rest)*)?] $o }
    };
    (@collect $v:ident $f:tt $g:tt $frame:tt [$($p:tt)*] [$($a:tt)*] [$name:ident : [$element:ty] $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!{ @collect $v $f $g $frame [$($p)* ($name $element)] [$($a)* ($name)] [$($($rest)*)?] $o }
    };
    (@collect $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident)
        [$(($param:ident $type:ty))*] [$($argument:tt)*] [] [$output:ident : [$element:ty]]) => {
        #[doc = "Kernel."]
        pub fn $v($frames: &FramePair, band: $crate::wiring::Band, mut buffers: $crate::wiring::Buffers) {
            let $frame = &$frames.now;
            $(let $param: &[$type] = buffers.read();)*
            let $output: &mut [$element] = buffers.write();
            band.for_each($crate::passes!(@extent $extent), $frame, |i, px, number| {
                $output[i] = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, number, $frame, [$($argument)*]);
            });
        }
    };
    (@collect $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident)
        [$(($param:ident $type:ty))*] [$($argument:tt)*] []
        [$first:ident : [$first_element:ty], $second:ident : [$second_element:ty]]) => {
        #[doc = "Kernel."]
        pub fn $v($frames: &FramePair, band: $crate::wiring::Band, mut buffers: $crate::wiring::Buffers) {
            let $frame = &$frames.now;
            $(let $param: &[$type] = buffers.read();)*
            let $first: &mut [$first_element] = buffers.write();
            let $second: &mut [$second_element] = buffers.write();
            band.for_each($crate::passes!(@extent $extent), $frame, |i, px, number| {
                ($first[i], $second[i]) = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, number, $frame, [$($argument)*]);
            });
        }
    };
}

/// Declares what is drawn. A row
///
/// ```text
/// present(left: [u32], right: [u32]) = present::present;
/// ```
///
/// gives two entry points in a module `screen::present`, `vertex` (one triangle over the whole target, by the function
/// `corner` of the same file) and `fragment` (the call), and a row of `DRAWS`. Binding 0 is the uniform
/// [`weir_shared::window::Window`].
#[macro_export]
macro_rules! draws {
    ($($name:ident ($($input:ident : [$element:ty]),+) = $file:ident :: $function:ident ;)*) => {
        /// GPU entry points of what is drawn: one module a row.
        #[cfg(not(all(feature = "ray-query", target_arch = "spirv")))]
        pub mod screen {
            $(
                #[doc = concat!("Entry points of `", stringify!($name), "`.")]
                pub mod $name {
                    use $crate::wiring::prelude::*;

                    /// Entry point.
                    #[spirv(vertex)]
                    pub fn vertex(#[spirv(vertex_index)] index: i32, #[spirv(position)] position: &mut Vec4) {
                        *position = $crate::$file::corner(index as u32);
                    }

                    $crate::draws!{ @number ($file $function) [1 2 3 4] [] [$($input : [$element]),+] }
                }
            )*
        }

        /// Everything that is drawn, in the order of the table.
        #[cfg(not(target_arch = "spirv"))]
        pub const DRAWS: &[$crate::wiring::Draw] = &[$(
            $crate::wiring::Draw {
                name: stringify!($name),
                vertex: concat!("screen::", stringify!($name), "::vertex"),
                fragment: concat!("screen::", stringify!($name), "::fragment"),
                bindings: &[$($crate::wiring::Binding::read::<$element>(stringify!($input))),+],
            },
        )*];
    };
    (@number $f:tt [$n0:literal $($n:literal)*] [$($p:tt)*] [$name:ident : [$element:ty] $(, $($rest:tt)*)?]) => {
        $crate::draws!{ @number $f [$($n)*] [$($p)* ($n0 $name $element)] [$($($rest)*)?] }
    };
    (@number ($file:ident $function:ident) $n:tt [$(($number:literal $param:ident $type:ty))*] []) => {
        /// Entry point.
        #[spirv(fragment)]
        pub fn fragment(
            #[spirv(frag_coord)] at: Vec4,
            #[spirv(uniform, descriptor_set = 0, binding = 0)] window: &Window,
            $(#[spirv(storage_buffer, descriptor_set = 0, binding = $number)] $param: &[$type],)*
            color: &mut Vec4,
        ) {
            *color = $crate::$file::$function(at.truncate().truncate(), window, $($param),*);
        }
    };
}

/// What rows of the tables may name.
pub mod prelude {
    #[cfg(not(target_arch = "spirv"))]
    pub use super::super::kernel;
    pub use glam::{UVec3, UVec4, Vec4};
    #[cfg(target_arch = "spirv")]
    pub use spirv_std::ray_tracing::AccelerationStructure;
    pub use spirv_std::spirv;
    #[cfg(target_arch = "spirv")]
    pub use weir_shared::ray_query::Queries;
    pub use weir_shared::{
        frame::FramePair, moments::Moments, numerics::store, presample::LightRecord, resample::Candidate,
        reservoir::Reservoir, scene::Scene, surface::Surface, window::Window,
    };
}

#[cfg(not(target_arch = "spirv"))]
pub use host::*;

#[cfg(not(target_arch = "spirv"))]
mod host {
    use bytemuck::Pod;
    use core::mem::size_of;
    use glam::UVec2;
    use weir_shared::frame::{Frame, FramePair};

    /// A property of the scene that changes the code of passes.
    #[derive(Clone, Copy, Debug, PartialEq, Eq, Hash)]
    #[expect(non_camel_case_types, reason = "rows and passes call their constants so")]
    pub enum Feature {
        /// Some material has an image.
        TEXTURES,
        /// Some material has an alpha mask.
        MASKS,
        /// Some material that emits has an image or an alpha mask.
        EMISSION_IMAGES,
        /// There are lights other than emissive triangles: an environment, directional lights or shapes.
        ENVIRONMENT,
        /// More than one instance, or one that is not in place.
        INSTANCES,
        /// Some material has a specular lobe.
        SPECULAR,
        /// There are surfaces whose light may have a closed form, see [`weir_shared::closed_form`].
        CLOSED_FORM,
    }

    /// How many elements a pass computes, and a buffer has.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Extent {
        /// One for each pixel.
        Pixels,
        /// One for each reservoir of each pixel.
        Reservoirs,
        /// One for each candidate of each reservoir.
        Candidates,
        /// One for each record of lights drawn ahead.
        Records,
    }

    /// Elements in rows and columns, and how many there are at each place.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Grid {
        /// Places in a row.
        pub columns: u32,
        /// Rows.
        pub rows: u32,
        /// Elements at each place.
        pub depth: u32,
    }

    impl Grid {
        /// Elements in all.
        pub fn elements(&self) -> u64 {
            u64::from(self.columns) * u64::from(self.rows) * u64::from(self.depth)
        }
    }

    impl Extent {
        /// What a pass of this extent runs over.
        pub fn grid(self, frame: &Frame) -> Grid {
            match self {
                Self::Pixels => Grid { columns: frame.width, rows: frame.height, depth: 1 },
                Self::Reservoirs => Grid { columns: frame.width, rows: frame.height, depth: frame.reservoirs },
                Self::Candidates => {
                    let depth = frame.reservoirs.saturating_mul(frame.candidates_in_memory());
                    Grid { columns: frame.width, rows: frame.height, depth }
                }
                Self::Records => Grid { columns: frame.presampled_columns, rows: frame.presampled_rows, depth: 1 },
            }
        }
    }

    impl std::fmt::Display for Extent {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str(match self {
                Self::Pixels => "pixel",
                Self::Reservoirs => "reservoir",
                Self::Candidates => "candidate",
                Self::Records => "record",
            })
        }
    }

    /// A row of the table.
    #[derive(Debug)]
    pub struct Pass {
        /// Name of the row; timer and message say the same.
        pub name: &'static str,
        /// Elements of its outputs.
        pub extent: Extent,
        /// Features that change its code.
        pub features: &'static [Feature],
        /// One for each combination: bit i of the index stands for feature i.
        pub variants: &'static [Variant],
        /// Storage buffers, at binding 1 and up; binding 0 is the frame.
        pub bindings: &'static [Binding],
    }

    /// A row of the table of what is drawn.
    #[derive(Debug)]
    pub struct Draw {
        /// Name of the row.
        pub name: &'static str,
        /// Name of the vertex stage in the SPIR-V module; it takes three vertices.
        pub vertex: &'static str,
        /// Name of the fragment stage.
        pub fragment: &'static str,
        /// Storage buffers, at binding 1 and up; binding 0 is the window.
        pub bindings: &'static [Binding],
    }

    /// A pass compiled for one combination of features.
    #[derive(Debug)]
    pub struct Variant {
        /// Name in the SPIR-V module.
        pub entry_point: &'static str,
        /// The same for the host: the pixels of a band.
        pub run: Kernel,
    }

    /// A host kernel. `Buffers` hold all of every input, and the band's rows of every output.
    pub type Kernel = fn(&FramePair, Band, Buffers);

    /// Whether a pass reads or writes a buffer.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub enum Access {
        /// All of it.
        Read,
        /// Its own element.
        Write,
    }

    /// A storage buffer of a pass.
    #[derive(Clone, Copy, Debug, PartialEq, Eq)]
    pub struct Binding {
        /// The resource; `prev_x` is what `x` was in the frame before.
        pub name: &'static str,
        /// Direction.
        pub access: Access,
        /// Bytes of an element.
        pub stride: usize,
    }

    impl Binding {
        /// An input of elements `T`.
        pub const fn read<T>(name: &'static str) -> Self {
            Self { name, access: Access::Read, stride: size_of::<T>() }
        }

        /// An output of elements `T`.
        pub const fn write<T>(name: &'static str) -> Self {
            Self { name, access: Access::Write, stride: size_of::<T>() }
        }
    }

    impl Pass {
        /// The variant for a scene with the given features.
        pub fn variant(&self, present: &[Feature]) -> &Variant {
            let bits = self.features.iter().enumerate().map(|(i, f)| usize::from(present.contains(f)) << i);
            &self.variants[bits.sum::<usize>()]
        }
    }

    /// Consecutive rows of a [`Grid`], walked in tiles of 8x8 places.
    #[derive(Clone, Copy, Debug)]
    pub struct Band {
        /// First row.
        pub first_row: u32,
        /// Number of rows.
        pub rows: u32,
        /// From the last pixel to the first. The result is the same; a test says so.
        pub backwards: bool,
    }

    impl Band {
        /// Calls `f` with the index within the band, the place, and the number of the element there.
        #[inline(always)]
        pub fn for_each(&self, extent: Extent, frame: &Frame, mut f: impl FnMut(usize, UVec2, u32)) {
            const TILE: u32 = 8;
            let Grid { columns: width, depth: numbers, .. } = extent.grid(frame);
            let (columns, rows) = (width.div_ceil(TILE), self.rows.div_ceil(TILE));
            for tile in 0..columns * rows {
                let tile = if self.backwards { columns * rows - 1 - tile } else { tile };
                let (x0, y0) = (tile % columns * TILE, tile / columns * TILE);
                for y in y0..(y0 + TILE).min(self.rows) {
                    for x in x0..(x0 + TILE).min(width) {
                        for number in 0..numbers {
                            let index = (y * numbers + number) * width + x;
                            f(index as usize, UVec2::new(x, self.first_row + y), number);
                        }
                    }
                }
            }
        }
    }

    /// The arguments of a kernel, as bytes, in the order of the bindings.
    pub struct Buffers<'a> {
        reads: core::slice::Iter<'a, &'a [u8]>,
        writes: core::slice::IterMut<'a, &'a mut [u8]>,
    }

    impl<'a> Buffers<'a> {
        /// Inputs and outputs apart, each in the order of the bindings.
        pub fn new(reads: &'a [&'a [u8]], writes: &'a mut [&'a mut [u8]]) -> Self {
            Self { reads: reads.iter(), writes: writes.iter_mut() }
        }

        /// The next input. Memory that others share may end within an element: that one is left out.
        pub fn read<T: Pod>(&mut self) -> &'a [T] {
            let bytes: &[u8] = self.reads.next().expect("an input for every binding");
            bytemuck::cast_slice(&bytes[..bytes.len() / size_of::<T>() * size_of::<T>()])
        }

        /// The next output.
        pub fn write<T: Pod>(&mut self) -> &'a mut [T] {
            bytemuck::cast_slice_mut(self.writes.next().expect("an output for every binding"))
        }
    }
}
