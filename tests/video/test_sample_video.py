from scene4d.video.sample import SAMPLE, sample_video


def test_the_pinned_file_is_the_real_one(shared_data):
    assert SAMPLE.size_bytes == (shared_data / "pets2009" / SAMPLE.file).stat().st_size
    assert SAMPLE.is_at(shared_data / "pets2009" / SAMPLE.file)
    assert sample_video(shared_data / "pets2009") == shared_data / "pets2009" / SAMPLE.file
