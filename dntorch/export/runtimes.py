"""Artefacts behind one face: a step, and a state to read and set.

A part of ``verify.py``: imports nothing that is not there without dntorch.
"""

from dntorch.export.reading import Unfit, at_rest


class Script:
    """TorchScript, which holds its state."""

    def __init__(self, path, manifest):
        import torch

        self.torch, self.module = torch, torch.jit.load(path)
        self.outputs = [port["name"] for port in manifest["outputs"]]
        self.switches = {port["name"]: float(port["rest"]) for port in manifest["switches"]}

    def state(self):
        return {k: v.numpy().copy() for k, v in self.module.get_state().items()}

    def set(self, state):
        self.module.set_state({k: self.torch.from_numpy(v.copy()) for k, v in state.items()})

    def step(self, inputs, switches):
        for name, value in switches.items():
            if self.switches[name] != float(value):
                self.module.learn(bool(value))
                self.switches[name] = float(value)
        output = self.module(*(self.torch.from_numpy(x.copy()) for x in inputs.values()))
        output = output if isinstance(output, tuple) else (output,)
        return dict(zip(self.outputs, (x.detach().numpy() for x in output)))


class Function:
    """A pure function: the state is held here, and starts as the manifest says."""

    def __init__(self, path, manifest):
        self.outputs = [port["name"] for port in manifest["outputs"]]
        self.names = [port["name"] for port in manifest["state"]]
        self.held = {port["name"]: at_rest(port) for port in manifest["state"]}
        self.load(path)

    def state(self):
        return dict(self.held)

    def set(self, state):
        self.held = {name: state[name] for name in self.names}

    def step(self, inputs, switches):
        gives = self.call([*inputs.values(), *switches.values(), *self.held.values()])
        count = len(self.outputs)
        self.held = dict(zip(self.names, gives[count:]))
        return dict(zip(self.outputs, gives[:count]))


class Torch(Function):
    """All that takes and gives torch tensors."""

    def call(self, arrays):
        import torch

        with torch.no_grad():
            tensors = self.function(*(torch.from_numpy(x.copy()) for x in arrays))
        return [tensor.numpy() for tensor in tensors]


class Export(Torch):
    def load(self, path):
        import torch

        self.function = torch.export.load(path).module()


class AOTInductor(Torch):
    def load(self, path):
        import torch

        self.function = torch._inductor.aoti_load_package(str(path))


class ExecuTorch(Torch):
    def load(self, path):
        from executorch.runtime import Runtime

        method = Runtime.get().load_program(str(path)).load_method("forward")
        self.function = lambda *tensors: method.execute(list(tensors))


class Onnx(Function):
    def load(self, path):
        import onnxruntime

        options = onnxruntime.SessionOptions()
        options.intra_op_num_threads = 1
        self.session = onnxruntime.InferenceSession(
            str(path), options, providers=["CPUExecutionProvider"]
        )
        self.takes = [port.name for port in self.session.get_inputs()]

    def call(self, arrays):
        if len(arrays) != len(self.takes):
            raise Unfit(f"takes {len(self.takes)} tensors, the manifest names {len(arrays)}")
        return self.session.run(None, dict(zip(self.takes, arrays)))


LOADERS = {
    "torchscript": Script,
    "export": Export,
    "onnx": Onnx,
    "aotinductor": AOTInductor,
    "executorch": ExecuTorch,
}
