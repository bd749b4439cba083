#pragma once
#include <cstdint>
#include <span>

#include "components/contacts.hpp"
namespace trocar {

// Makes room for `count` rows, all columns but `carried`; impulses are set to zero.
void resize_rows(ContactRows& rows, size_t count);

// Takes out the rows that are marked, one mark a row; the others keep their order.
void take_out_rows(std::span<const uint8_t> dropped, ContactRows& rows);

}  // namespace trocar
