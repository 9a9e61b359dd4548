"""From sensor messages to the common map: arrays and poses in, `common.mapping.mapper.Mapper` out."""
