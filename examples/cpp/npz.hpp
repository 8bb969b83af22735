// Reads .npz files as numpy.savez writes them: stored, not compressed, little-endian.
#pragma once

#include <torch/csrc/api/include/torch/types.h>

#include <cstdint>
#include <cstring>
#include <fstream>
#include <iterator>
#include <map>
#include <stdexcept>
#include <string>
#include <vector>

namespace npz {

using Arrays = std::map<std::string, torch::Tensor>;

template <typename T>
T read(const std::string& bytes, size_t at) {
  T value;
  if (at > bytes.size() || bytes.size() - at < sizeof(T))
    throw std::runtime_error("golden record is truncated: export again");
  std::memcpy(&value, bytes.data() + at, sizeof(T));
  return value;
}

// One .npy file: magic, a Python dict with type and shape as text, then the numbers.
inline torch::Tensor array(const std::string& bytes, size_t at, size_t size) {
  const bool first = read<uint8_t>(bytes, at + 6) == 1;
  const size_t begin = at + (first ? 10 : 12);
  const size_t length = first ? read<uint16_t>(bytes, at + 8) : read<uint32_t>(bytes, at + 8);
  const std::string header = bytes.substr(begin, length);

  static const std::map<std::string, torch::Dtype> dtypes = {
      {"<f4", torch::kFloat32}, {"<f8", torch::kFloat64}, {"<i8", torch::kInt64},
      {"|u1", torch::kUInt8},   {"|b1", torch::kBool}};
  const size_t type = header.find("'descr': '") + 10;
  const auto dtype = dtypes.find(header.substr(type, header.find('\'', type) - type));
  if (dtype == dtypes.end() || header.find("'fortran_order': False") == std::string::npos)
    throw std::runtime_error("an array of the golden record has another layout: " + header);

  std::vector<int64_t> shape;
  for (size_t k = header.find("'shape': (") + 10; header[k] != ')'; ++k)
    if (isdigit(header[k])) {
      shape.push_back(std::stoll(header.substr(k)));
      while (isdigit(header[k + 1])) ++k;
    }
  torch::Tensor tensor = torch::empty(shape, dtype->second);
  if (begin + length + tensor.nbytes() > at + size)
    throw std::runtime_error("golden record is truncated: export again");
  std::memcpy(tensor.data_ptr(), bytes.data() + begin + length, tensor.nbytes());
  return tensor;
}

// Sizes and places of files stand in the directory at the end of a zip archive.
inline Arrays load(const std::string& path) {
  std::ifstream file(path, std::ios::binary);
  if (!file) throw std::runtime_error(path + " cannot be read: name a folder of an export");
  const std::string bytes((std::istreambuf_iterator<char>(file)), {});
  const size_t end = bytes.rfind("PK\5\6");
  if (end == std::string::npos) throw std::runtime_error(path + " is truncated: export again");

  Arrays arrays;
  size_t entry = read<uint32_t>(bytes, end + 16);
  for (int count = read<uint16_t>(bytes, end + 10); count > 0; --count) {
    if (read<uint16_t>(bytes, entry + 10) != 0)
      throw std::runtime_error(path + " is compressed: write it with numpy.savez");
    const size_t size = read<uint32_t>(bytes, entry + 20);
    const size_t name = read<uint16_t>(bytes, entry + 28);
    const size_t extra = read<uint16_t>(bytes, entry + 30) + read<uint16_t>(bytes, entry + 32);
    const size_t local = read<uint32_t>(bytes, entry + 42);
    const size_t data =
        local + 30 + read<uint16_t>(bytes, local + 26) + read<uint16_t>(bytes, local + 28);
    arrays[bytes.substr(entry + 46, name - 4)] = array(bytes, data, size);  // without ".npy"
    entry += 46 + name + extra;
  }
  return arrays;
}

}  // namespace npz
