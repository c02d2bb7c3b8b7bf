"""Writes operators.onnx, a small network with random weights that uses every supported operator, and what PyTorch computes
with it, to operators.txt.

    python3 -m venv venv && venv/bin/pip install numpy torch onnx
    cd perception/tests/parity && ../../../venv/bin/python network.py
"""

import onnx
import torch
from torch import nn

SIDES = 20, 28


class Residual(nn.Module):
    def __init__(self, channels):
        super().__init__()
        self.depthwise = nn.Conv2d(channels, channels, 3, padding=1, groups=channels, bias=False)
        self.norm = nn.BatchNorm2d(channels)
        self.limit = nn.ReLU6()
        self.pointwise = nn.Conv2d(channels, channels, 1)

    def forward(self, x):
        return x + self.pointwise(self.limit(self.norm(self.depthwise(x))))


def model():
    net = nn.Sequential(
        nn.Conv2d(1, 12, 5, stride=2, padding=2), nn.ReLU(), Residual(12), nn.MaxPool2d(3, stride=2, padding=1),
        nn.Conv2d(12, 20, (3, 1), padding=(1, 0)), nn.ReLU(), nn.AvgPool2d(2, stride=1, padding=1), Residual(20),
        nn.Conv2d(20, 24, 3, stride=(1, 2)), nn.ReLU(), nn.AdaptiveAvgPool2d(1), nn.Flatten(), nn.Linear(24, 10), nn.ReLU(),
        nn.Dropout(0.5), nn.Linear(10, 3), nn.LogSoftmax(1),
    )
    for module in net.modules():
        if isinstance(module, (nn.Conv2d, nn.Linear)):
            nn.init.normal_(module.weight, 0, 1.5 / module.weight[0].numel() ** 0.5)
        if isinstance(module, nn.BatchNorm2d):
            module.running_mean.normal_(0, 0.3)
            module.running_var.uniform_(0.5, 2)
            nn.init.uniform_(module.weight, 0.5, 1.5)
            nn.init.normal_(module.bias, 0, 0.3)
    return net.eval()


def inputs(count):
    """Numbers that the test computes, too."""
    height, width = SIDES
    i = torch.arange(count * height * width)
    row, column = i // width % height, i % width
    wave = (row * (i // (height * width) + 1) + 2 * column) % 16
    return ((i * 7919 % 1009).float() / 1009 * 2 - 1 + wave / 4).reshape(count, 1, height, width)


torch.manual_seed(3)
net = model()
# With all operators as they are, the normalisation apart from the convolution before it.
torch.onnx.export(net, torch.zeros(1, 1, *SIDES), "operators.onnx", opset_version=17, dynamo=False,
                  do_constant_folding=False, training=torch.onnx.TrainingMode.PRESERVE)
file = onnx.load("operators.onnx")
for key, value in (("labels", "other,one,two"), ("margin", "0.25")):
    entry = file.metadata_props.add()
    entry.key, entry.value = key, value
onnx.save(file, "operators.onnx")
print(sorted({node.op_type for node in file.graph.node}))
with torch.no_grad():
    rows = net(inputs(4))
with open("operators.txt", "w") as out:
    out.write(f"# network.py: logarithms of the softmax, by PyTorch {torch.__version__.split('+')[0]}\n")
    for row in rows.tolist():
        out.write(" ".join(f"{v:.7g}" for v in row) + "\n")
