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
//!     #[spirv(workgroup_id)] group: UVec3,
//!     #[spirv(local_invocation_id)] within: UVec3,
//!     #[spirv(uniform, descriptor_set = 0, binding = 0)] frames: &FramePair,
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 1)] triangles: &[f32],   // `scene` is three buffers
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 2)] records: &[u32],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 3)] texels: &[u32],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 4)] surfaces: &[Surface],
//!     #[spirv(storage_buffer, descriptor_set = 0, binding = 5)] color: &mut [Vec4],
//! ) {
//!     let frame = &frames.now;
//!     let px = group.truncate() * tiles::BLOCK + within.truncate();
//!     if px.x < frame.width && px.y < frame.height {
//!         let value = shade::shade::<true>(px, frame, &Scene { triangles, records, texels }, surfaces);
//!         store(color, frame.index_of(px), value);
//!     }
//! }
//! ```
//!
//! in a module `entry::shade`, a host kernel with the same call in a module `kernel::shade`, and a row of `PASSES`.
//! A row that starts with `reservoir` instead of `pixel` runs once for each reservoir of each pixel: the function gets its
//! number after the pixel, and outputs have an element for each; `candidate` does so for each candidate of each. Both run
//! over a list of tiles, see [`weir_shared::tiles`], which is their first input, on a GPU a uniform at binding 1; of other
//! tiles they write nothing. A row that starts with `record` runs once for each record of lights drawn ahead: instead of
//! the pixel the function gets column and row of the record; so do `block`, `row` and `vector` for what the list of tiles
//! is made of. The input `prev_frame` stands
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
                    bindings: $crate::passes!(@bindings $extent [] [$($input)*] [$($output : [$element]),+]),
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
    (@extent block) => { $crate::wiring::Extent::Blocks };
    (@extent row) => { $crate::wiring::Extent::TileRows };
    (@extent vector) => { $crate::wiring::Extent::TileList };

    // Columns and rows that a pass runs over.
    (@columns record $frame:ident) => { $frame.presampled_columns };
    (@columns block $frame:ident) => { tiles::blocks($frame.width) };
    (@columns row $frame:ident) => { tiles::Tiling::of($frame).rows };
    (@columns vector $frame:ident) => { tiles::LIST_VECTORS };
    (@columns $extent:ident $frame:ident) => { $frame.width };
    (@rows record $frame:ident) => { $frame.presampled_rows };
    (@rows block $frame:ident) => { tiles::blocks($frame.height) };
    (@rows row $frame:ident) => { 1 };
    (@rows vector $frame:ident) => { 1 };
    (@rows $extent:ident $frame:ident) => { $frame.height };

    // Where an invocation is on a GPU, and the list of tiles on the host.
    (@place reservoir $frame:ident, $tiles:ident, $group:ident, $within:ident) => {
        tiles::pixel($frame, $tiles, $group.truncate(), $within.truncate())
    };
    (@place candidate $frame:ident, $tiles:ident, $group:ident, $within:ident) => {
        tiles::pixel($frame, $tiles, $group.truncate(), $within.truncate())
    };
    (@place $extent:ident $frame:ident, $tiles:ident, $group:ident, $within:ident) => {
        $group.truncate() * tiles::BLOCK + $within.truncate()
    };
    (@tiles reservoir $buffers:ident) => { $buffers.read() };
    (@tiles candidate $buffers:ident) => { $buffers.read() };
    (@tiles $extent:ident $buffers:ident) => { &[] };

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
    (@index block $px:ident, $number:expr, $frame:ident) => { $frame.index_of_block($px) };
    (@index row $px:ident, $number:expr, $frame:ident) => { $px.x };
    (@index vector $px:ident, $number:expr, $frame:ident) => { $px.x };

    // The list of bindings, `scene` expanded.
    (@bindings reservoir [] $i:tt $o:tt) => { $crate::passes!(@bindings [(uniform tiles UVec4)] $i $o) };
    (@bindings candidate [] $i:tt $o:tt) => { $crate::passes!(@bindings [(uniform tiles UVec4)] $i $o) };
    (@bindings $extent:ident [] $i:tt $o:tt) => { $crate::passes!(@bindings [] $i $o) };
    (@bindings $done:tt [prev_frame, $($rest:tt)*] $o:tt) => {
        $crate::passes!(@bindings $done [$($rest)*] $o)
    };
    (@bindings [$($done:tt)*] [rays $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!(@bindings [$($done)* (read bvh UVec4)] [$($($rest)*)?] $o)
    };
    (@bindings [$($done:tt)*] [scene $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!(@bindings [$($done)* (read triangles f32) (read records u32) (read texels u32)] [$($($rest)*)?] $o)
    };
    (@bindings [$($done:tt)*] [$name:ident : [$element:ty] $(, $($rest:tt)*)?] $o:tt) => {
        $crate::passes!(@bindings [$($done)* (read $name $element)] [$($($rest)*)?] $o)
    };
    (@bindings [$(($kind:ident $input:ident $type:ty))*] [] [$($output:ident : [$element:ty]),+]) => {
        &[
            $($crate::wiring::Binding::$kind::<$type>(stringify!($input)),)*
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
    (@entry $variant:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] [$($i:tt)*] $o:tt) => {
        $crate::passes!{ @start $extent $variant ($extent $file $function) [$($flag),*] [$($i)*] $o }
    };
    (@start reservoir $v:ident $f:tt $g:tt $i:tt $o:tt) => {
        $crate::passes!{ @listed $v $f $g (frames frame tiles) $i $o }
    };
    (@start candidate $v:ident $f:tt $g:tt $i:tt $o:tt) => {
        $crate::passes!{ @listed $v $f $g (frames frame tiles) $i $o }
    };
    (@start $extent:ident $v:ident $f:tt $g:tt $i:tt $o:tt) => {
        $crate::passes!{ @number $v $f $g (frames frame tiles) [1 2 3 4 5 6 7 8 9 10 11 12] [] [] $i $o }
    };
    (@listed $v:ident $f:tt $g:tt ($frames:ident $frame:ident $tiles:ident) $i:tt $o:tt) => {
        $crate::passes!{ @number $v $f $g ($frames $frame $tiles) [2 3 4 5 6 7 8 9 10 11 12 13]
            [(1 $tiles TileList, uniform)] [] $i $o }
    };
    (@number $v:ident $f:tt $g:tt ($frames:ident $frame:ident $tiles:ident) $n:tt $p:tt [$($a:tt)*] [prev_frame, $($rest:tt)*] $o:tt) => {
        $crate::passes!{ @number $v $f $g ($frames $frame $tiles) $n $p [$($a)* (&$frames.prev)] [$($rest)*] $o }
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
    (@number $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident $tiles:ident) [$n0:literal $($n:literal)*]
        [$(($number:literal $param:ident $type:ty $(, $class:ident)?))*] [$($argument:tt)*] [] [$output:ident : [$element:ty]]) => {
        #[spirv(compute(threads(8, 8)))]
        #[doc = "Entry point."]
        pub fn $v(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(local_invocation_id)] within: UVec3,
            #[spirv(uniform, descriptor_set = 0, binding = 0)] $frames: &FramePair,
            $(#[spirv($($class,)? descriptor_set = 0, binding = $number)] $param: &$type,)*
            #[spirv(storage_buffer, descriptor_set = 0, binding = $n0)] $output: &mut [$element],
        ) {
            let $frame = &$frames.now;
            let px = $crate::passes!(@place $extent $frame, $tiles, group, within);
            if px.x < $crate::passes!(@columns $extent $frame) && px.y < $crate::passes!(@rows $extent $frame) {
                let value = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, group.z, $frame, [$($argument)*]);
                store($output, $crate::passes!(@index $extent px, group.z, $frame), value);
            }
        }
    };
    (@number $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident $tiles:ident) [$n0:literal $n1:literal $($n:literal)*]
        [$(($number:literal $param:ident $type:ty $(, $class:ident)?))*] [$($argument:tt)*] []
        [$first:ident : [$first_element:ty], $second:ident : [$second_element:ty]]) => {
        #[spirv(compute(threads(8, 8)))]
        #[doc = "Entry point."]
        pub fn $v(
            #[spirv(workgroup_id)] group: UVec3,
            #[spirv(local_invocation_id)] within: UVec3,
            #[spirv(uniform, descriptor_set = 0, binding = 0)] $frames: &FramePair,
            $(#[spirv($($class,)? descriptor_set = 0, binding = $number)] $param: &$type,)*
            #[spirv(storage_buffer, descriptor_set = 0, binding = $n0)] $first: &mut [$first_element],
            #[spirv(storage_buffer, descriptor_set = 0, binding = $n1)] $second: &mut [$second_element],
        ) {
            let $frame = &$frames.now;
            let px = $crate::passes!(@place $extent $frame, $tiles, group, within);
            if px.x < $crate::passes!(@columns $extent $frame) && px.y < $crate::passes!(@rows $extent $frame) {
                let value = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, group.z, $frame, [$($argument)*]);
                let index = $crate::passes!(@index $extent px, group.z, $frame);
                store($first, index, value.0);
                store($second, index, value.1);
            }
        }
    };

    // Host kernel: read the same arguments in the same order, then walk the tiles of a band of rows.
    (@kernel $variant:ident $f:tt [$($flag:literal),*] [$($i:tt)*] $o:tt) => {
        $crate::passes!{ @collect $variant $f [$($flag),*] (frames frame tiles) [] [] [$($i)*] $o }
    };
    (@collect $v:ident $f:tt $g:tt ($frames:ident $frame:ident $tiles:ident) $p:tt [$($a:tt)*] [prev_frame, $($rest:tt)*] $o:tt) => {
        $crate::passes!{ @collect $v $f $g ($frames $frame $tiles) $p [$($a)* (&$frames.prev)] [$($rest)*] $o }
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
    (@collect $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident $tiles:ident)
        [$(($param:ident $type:ty))*] [$($argument:tt)*] [] [$output:ident : [$element:ty]]) => {
        #[doc = "Kernel."]
        pub fn $v($frames: &FramePair, band: $crate::wiring::Band, mut buffers: $crate::wiring::Buffers) {
            let $frame = &$frames.now;
            let $tiles: &[UVec4] = $crate::passes!(@tiles $extent buffers);
            $(let $param: &[$type] = buffers.read();)*
            let $output: &mut [$element] = buffers.write();
            band.for_each($crate::passes!(@extent $extent), $frame, $tiles, |i, px, number| {
                $output[i] = $crate::passes!(@call $extent $crate::$file::$function::<$($flag),*>, px, number, $frame, [$($argument)*]);
            });
        }
    };
    (@collect $v:ident ($extent:ident $file:ident $function:ident) [$($flag:literal),*] ($frames:ident $frame:ident $tiles:ident)
        [$(($param:ident $type:ty))*] [$($argument:tt)*] []
        [$first:ident : [$first_element:ty], $second:ident : [$second_element:ty]]) => {
        #[doc = "Kernel."]
        pub fn $v($frames: &FramePair, band: $crate::wiring::Band, mut buffers: $crate::wiring::Buffers) {
            let $frame = &$frames.now;
            let $tiles: &[UVec4] = $crate::passes!(@tiles $extent buffers);
            $(let $param: &[$type] = buffers.read();)*
            let $first: &mut [$first_element] = buffers.write();
            let $second: &mut [$second_element] = buffers.write();
            band.for_each($crate::passes!(@extent $extent), $frame, $tiles, |i, px, number| {
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
        block::Block, frame::FramePair, moments::Moments, numerics::store, presample::LightRecord, resample::Candidate,
        reservoir::Reservoir, scene::Scene, surface::Surface, tiles, tiles::TileList, window::Window,
    };
}

#[cfg(not(target_arch = "spirv"))]
pub use host::*;

#[cfg(not(target_arch = "spirv"))]
mod host {
    use bytemuck::Pod;
    use core::{mem::size_of, ops::Range};
    use glam::{UVec2, UVec4};
    use weir_shared::{
        frame::{Frame, FramePair},
        tiles::{self, BLOCK, Tiling},
    };

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
        /// One for each block of 8x8 pixels.
        Blocks,
        /// One for each row of tiles, see [`tiles::Tiling`].
        TileRows,
        /// One for each vector of the list of tiles.
        TileList,
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
                Self::Blocks => {
                    Grid { columns: tiles::blocks(frame.width), rows: tiles::blocks(frame.height), depth: 1 }
                }
                Self::TileRows => Grid { columns: Tiling::of(frame).rows, rows: 1, depth: 1 },
                Self::TileList => Grid { columns: tiles::LIST_VECTORS, rows: 1, depth: 1 },
            }
        }

        /// Whether passes of it run over a list of tiles: those that sample light.
        pub const fn is_listed(self) -> bool {
            matches!(self, Self::Reservoirs | Self::Candidates)
        }
    }

    impl std::fmt::Display for Extent {
        fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
            f.write_str(match self {
                Self::Pixels => "pixel",
                Self::Reservoirs => "reservoir",
                Self::Candidates => "candidate",
                Self::Records => "record",
                Self::Blocks => "block of 8x8 pixels",
                Self::TileRows => "row of tiles",
                Self::TileList => "vector of the list of tiles",
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
        /// Buffers, at binding 1 and up; binding 0 is the frame.
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
        /// Whether a GPU binds it as a uniform.
        pub is_uniform: bool,
    }

    impl Binding {
        /// An input of elements `T`.
        pub const fn read<T>(name: &'static str) -> Self {
            Self { name, access: Access::Read, stride: size_of::<T>(), is_uniform: false }
        }

        /// An input that is small enough to be a uniform.
        pub const fn uniform<T>(name: &'static str) -> Self {
            Self { is_uniform: true, ..Self::read::<T>(name) }
        }

        /// An output of elements `T`.
        pub const fn write<T>(name: &'static str) -> Self {
            Self { access: Access::Write, ..Self::read::<T>(name) }
        }
    }

    impl Pass {
        /// How many storage buffers it binds.
        pub fn storage_buffers(&self) -> usize {
            self.bindings.iter().filter(|binding| !binding.is_uniform).count()
        }

        /// The variant for a scene with the given features.
        pub fn variant(&self, present: &[Feature]) -> &Variant {
            let bits = self.features.iter().enumerate().map(|(i, f)| usize::from(present.contains(f)) << i);
            &self.variants[bits.sum::<usize>()]
        }
    }

    /// Consecutive rows of a [`Grid`], walked in tiles.
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
        /// Calls `f` with the index within the band, the place, and the number of the element there; only of the tiles in
        /// `list` if `extent` goes by it.
        #[inline(always)]
        pub fn for_each(&self, extent: Extent, frame: &Frame, list: &[UVec4], mut f: impl FnMut(usize, UVec2, u32)) {
            let Grid { columns: width, depth: numbers, .. } = extent.grid(frame);
            let parts = Parts::new(self, extent, frame, list);
            for (columns, rows) in self.ordered(parts.places.clone()).map(|place| parts.part(place, list)) {
                for y in rows {
                    for x in columns.clone() {
                        for number in 0..numbers {
                            let index = (y * numbers + number) * width + x;
                            f(index as usize, UVec2::new(x, self.first_row + y), number);
                        }
                    }
                }
            }
        }

        /// Numbers in the band's order.
        fn ordered(&self, numbers: Range<u32>) -> impl Iterator<Item = u32> + use<> {
            let (backwards, Range { start, end }) = (self.backwards, numbers);
            (start..end).map(move |number| if backwards { end - 1 - (number - start) } else { number })
        }
    }

    /// The parts of tiles that are in a band.
    struct Parts {
        band: Band,
        width: u32,
        /// Edge of a tile, and how many are in a row.
        edge: u32,
        columns: u32,
        /// Of the list if there is one, else of all tiles of the band.
        places: Range<u32>,
        is_listed: bool,
    }

    impl Parts {
        fn new(band: &Band, extent: Extent, frame: &Frame, list: &[UVec4]) -> Self {
            let width = extent.grid(frame).columns;
            if !extent.is_listed() || !tiles::is_listed(list[0]) {
                let columns = width.div_ceil(BLOCK);
                let places = 0..columns * band.rows.div_ceil(BLOCK);
                return Self { band: *band, width, edge: BLOCK, columns, places, is_listed: false };
            }
            let Tiling { shift, columns, .. } = Tiling::of(frame);
            let edge = BLOCK << shift;
            let first = band.first_row / edge * columns;
            let end = (band.first_row + band.rows).div_ceil(edge) * columns;
            // The list is in order.
            let up_to = |tile| partition_point(0..tiles::length(list), |place| tiles::listed(list, place) < tile);
            Self { band: *band, width, edge, columns, places: up_to(first)..up_to(end), is_listed: true }
        }

        /// Columns, and rows counted from the band's first.
        fn part(&self, place: u32, list: &[UVec4]) -> (Range<u32>, Range<u32>) {
            let &Self { band: Band { first_row, rows, .. }, width, edge, columns, is_listed, .. } = self;
            let tile = if is_listed { tiles::listed(list, place) } else { place };
            let (x, y) = (tile % columns * edge, tile / columns * edge);
            // Tiles of the list are of the picture, others of the band.
            let (top, bottom) =
                if is_listed { (y.max(first_row) - first_row, y + edge - first_row) } else { (y, y + edge) };
            (x..(x + edge).min(width), top..bottom.min(rows))
        }
    }

    /// The first of the numbers of which `is_before` does not hold; it holds of none after that.
    fn partition_point(numbers: Range<u32>, is_before: impl Fn(u32) -> bool) -> u32 {
        let Range { mut start, mut end } = numbers;
        while start < end {
            let middle = start + (end - start) / 2;
            if is_before(middle) {
                start = middle + 1;
            } else {
                end = middle;
            }
        }
        start
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

#[cfg(test)]
mod tests;
