//! Numbers of the SPIR-V instructions that the emulator knows.
#![allow(non_upper_case_globals)] // Named as the specification does.

macro_rules! ops {
    ($($name:ident = $number:literal),+ $(,)?) => {
        $(pub const $name: u16 = $number;)+

        /// The name of an instruction; its number if the emulator does not know it.
        pub fn name(op: u16) -> String {
            match op {
                $($number => concat!("Op", stringify!($name)).into(),)+
                _ => format!("instruction {op}"),
            }
        }
    };
}

ops! {
    Undef = 1, ExtInstImport = 11, ExtInst = 12, EntryPoint = 15, ExecutionMode = 16,
    TypeVoid = 19, TypeBool = 20, TypeInt = 21, TypeFloat = 22, TypeVector = 23, TypeArray = 28,
    TypeRuntimeArray = 29, TypeStruct = 30, TypePointer = 32, TypeFunction = 33,
    ConstantTrue = 41, ConstantFalse = 42, Constant = 43, ConstantComposite = 44, ConstantNull = 46,
    SpecConstant = 50, Function = 54, FunctionEnd = 56, Variable = 59,
    Load = 61, Store = 62, CopyMemory = 63, AccessChain = 65, InBoundsAccessChain = 66,
    ArrayLength = 68, Decorate = 71, MemberDecorate = 72, CompositeConstruct = 80,
    CompositeExtract = 81, CompositeInsert = 82, ConvertFToU = 109, ConvertFToS = 110,
    ConvertSToF = 111, ConvertUToF = 112, Bitcast = 124, SNegate = 126, FNegate = 127, IAdd = 128,
    FAdd = 129, ISub = 130, FSub = 131, IMul = 132, FMul = 133, UDiv = 134, FDiv = 136, UMod = 137,
    LogicalEqual = 164, LogicalNotEqual = 165, LogicalOr = 166, LogicalAnd = 167, LogicalNot = 168,
    Select = 169, IEqual = 170, INotEqual = 171, UGreaterThan = 172, SGreaterThan = 173,
    UGreaterThanEqual = 174, SGreaterThanEqual = 175, ULessThan = 176, SLessThan = 177,
    ULessThanEqual = 178, SLessThanEqual = 179, FOrdEqual = 180, FUnordEqual = 181,
    FOrdNotEqual = 182, FUnordNotEqual = 183, FOrdLessThan = 184, FUnordLessThan = 185,
    FOrdGreaterThan = 186, FUnordGreaterThan = 187, FOrdLessThanEqual = 188,
    FUnordLessThanEqual = 189, FOrdGreaterThanEqual = 190, FUnordGreaterThanEqual = 191,
    ShiftRightLogical = 194, ShiftRightArithmetic = 195, ShiftLeftLogical = 196, BitwiseOr = 197,
    BitwiseXor = 198, BitwiseAnd = 199, Not = 200, BitCount = 205, ControlBarrier = 224,
    AtomicIAdd = 234, AtomicUMax = 239, Phi = 245, LoopMerge = 246, SelectionMerge = 247,
    Label = 248, Branch = 249, BranchConditional = 250, Switch = 251, Return = 253,
    Unreachable = 255, GroupNonUniformAll = 334, GroupNonUniformAny = 335,
    GroupNonUniformBroadcast = 337, GroupNonUniformBallot = 339, GroupNonUniformShuffle = 345,
    GroupNonUniformIAdd = 349, GroupNonUniformFAdd = 350,
}
